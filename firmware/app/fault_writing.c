#include "app/fault_writing.h"

#include "app/reaction.h"

/* An output that is held away from its safe value may have to go there at once: it bears a millisecond, no erase. */
static bool may_write(const struct device *device)
{
    const struct control *control = &device->control;
    if ((control->state != WIRE_STATE_PARKED && control->state != WIRE_STATE_FAULT) || device->recorder.recording ||
        !device_stands_still(device))
        return false;
    return control->state == WIRE_STATE_PARKED || device_at_rest_mask(device) == ALL_AXES ||
           !journal_is_full(&device->journal);
}

static bool write_next(struct device *device)
{
    struct fault_log *log = device->port.fault_log;
    uint32_t written = atomic_load_explicit(&log->written, memory_order_relaxed);
    if (atomic_load_explicit(&log->put, memory_order_acquire) == written)
        return journal_write(&device->journal, &device->port.records, NULL, NULL);
    bool done =
        journal_write(&device->journal, &device->port.records, NULL, &log->waiting[written % FAULT_LOG_WAITING]);
    atomic_store_explicit(&log->written, written + 1, memory_order_release); /* or given up */
    return done;
}

static bool is_due(const struct device *device)
{
    const struct fault_log *log = device->port.fault_log;
    if (device->journal.started && atomic_load_explicit(&log->put, memory_order_relaxed) ==
                                       atomic_load_explicit(&log->written, memory_order_relaxed))
        return false;
    device_lock(device);
    bool may = may_write(device);
    device_unlock(device);
    return may;
}

void fault_log_write(struct device *device)
{
    while (is_due(device)) {
        bool done = write_next(device);
        device->journal.started = true;
        if (!done)
            device_raise(device, WIRE_FAULT_FLASH_ERROR, NO_AXIS, device->journal.newest.sequence);
    }
}
