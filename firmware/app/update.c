#include "app/update.h"

#include <string.h>

void update_init(struct update *update, const struct update_port *port)
{
    memset(update, 0, sizeof *update);
    update->on_trial = port->on_trial;
}

void update_read_record(struct update *update, const struct update_port *port)
{
    boot_record_read(&port->flash, &update->record);
    update->rolled_back = !update->on_trial && update->record.trial != BOOT_NO_SLOT;
    if (update->record.confirmed == port->slot)
        boot_record_settle(&port->flash, &update->record);
}

bool update_restart_is_due(const struct update *update, uint64_t tick)
{
    return (update->restarting && tick >= update->restart_tick) || (update->on_trial && tick >= UPDATE_TRIAL_TICKS);
}
