#include "app/device_init.h"

#include <string.h>

#include "app/reaction.h"

void device_init(struct device *device, const struct device_port *port)
{
    memset(device, 0, sizeof *device);
    device->port = *port;
    device->control.timeout_ticks = HOST_TIMEOUT_TICKS;
    device->control.fault_axis = NO_AXIS;
    update_init(&device->update, &device->port.update);
    model_store_boot(&device->models, &device->port.flash);
    journal_boot(&device->journal, &device->port.records);
    fault_log_boot(device->port.fault_log, &device->journal);
    device_link_models(device);
    device_make_idle_again(device);
    device_reset_axes(device);
    device_rest(device);
    line_init(&device->line);
    transient_reset(&device->transient);
    for (unsigned axis = 0; axis < AXES; axis++) {
        bool saturated = false;
        device->dac_codes[axis] = converter_dac_code(&device->control.config[axis].converter, 0, &saturated);
    }
    if (port->reset_cause == WIRE_RESET_CAUSE_WATCHDOG)
        device_fault(device, WIRE_FAULT_CORE_LOST, NO_AXIS, 0);
}
