#include "app/update.h"

#include <string.h>

#include "app/device.h"

void update_init(struct device *device)
{
    const struct update_port *port = &device->port.update;
    memset(&device->update, 0, sizeof device->update);
    if (port->flash.read == NULL)
        return;
    device->update.on_trial = port->on_trial;
    boot_record_read(&port->flash, &device->update.record);
    device->update.rolled_back = !port->on_trial && device->update.record.trial != BOOT_NO_SLOT;
}

void update_settle(struct device *device)
{
    const struct update_port *port = &device->port.update;
    if (port->flash.read != NULL && device->update.record.confirmed == port->slot)
        boot_record_settle(&port->flash, &device->update.record);
}

bool update_restart_is_due(const struct device *device)
{
    const struct update *update = &device->update;
    uint64_t tick = device->control.tick;
    return (update->restarting && tick >= update->restart_tick) || (update->on_trial && tick >= UPDATE_TRIAL_TICKS);
}
