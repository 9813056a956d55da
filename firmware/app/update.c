#include "app/update.h"

#include <string.h>

#include "app/device.h"

void update_init(struct device *device)
{
    memset(&device->update, 0, sizeof device->update);
    device->update.on_trial = device->port.update.on_trial;
}

void update_read_record(struct device *device)
{
    const struct update_port *port = &device->port.update;
    struct update *update = &device->update;
    if (port->flash.read == NULL)
        return;
    boot_record_read(&port->flash, &update->record);
    update->rolled_back = !update->on_trial && update->record.trial != BOOT_NO_SLOT;
    if (update->record.confirmed == port->slot)
        boot_record_settle(&port->flash, &update->record);
}

bool update_restart_is_due(const struct device *device)
{
    const struct update *update = &device->update;
    uint64_t tick = device->control.tick;
    return (update->restarting && tick >= update->restart_tick) || (update->on_trial && tick >= UPDATE_TRIAL_TICKS);
}
