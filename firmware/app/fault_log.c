#include "app/fault_log.h"

#include "app/device.h"
#include "app/reaction.h"

void fault_log_put(struct device *device)
{
    struct fault_log *log = &device->fault_log;
    const struct control *control = &device->control;
    uint32_t put = atomic_load_explicit(&log->put, memory_order_relaxed);
    if (put - atomic_load_explicit(&log->written, memory_order_acquire) >= FAULT_LOG_WAITING)
        return;
    log->waiting[put % FAULT_LOG_WAITING] =
        (struct wire_logged_fault){.power_cycle = device->journal.newest.power_cycle,
                                   .tick = control->fault_tick,
                                   .detail = control->fault_detail,
                                   .fault = (uint8_t)control->fault,
                                   .axis = (uint8_t)control->fault_axis,
                                   .state = (uint8_t)control->state};
    atomic_store_explicit(&log->put, put + 1, memory_order_release);
}

/* An output that is held away from its safe value may have to go there at once: it bears a millisecond, no erase. */
static bool may_write(const struct device *device)
{
    const struct control *control = &device->control;
    if ((control->state != WIRE_STATE_PARKED && control->state != WIRE_STATE_FAULT) || device->recorder.recording)
        return false;
    if (device_at_rest_mask(device) == ALL_AXES)
        return true;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (control->axis[axis].drive != DRIVE_HOLD)
            return false;
    return control->state == WIRE_STATE_PARKED || !journal_is_full(&device->journal);
}

static bool write_next(struct device *device)
{
    struct fault_log *log = &device->fault_log;
    uint32_t written = atomic_load_explicit(&log->written, memory_order_relaxed);
    if (atomic_load_explicit(&log->put, memory_order_acquire) == written)
        return journal_write(&device->journal, &device->port.records, NULL, NULL);
    bool done =
        journal_write(&device->journal, &device->port.records, NULL, &log->waiting[written % FAULT_LOG_WAITING]);
    atomic_store_explicit(&log->written, written + 1, memory_order_release); /* or given up */
    return done;
}

void fault_log_write(struct device *device)
{
    struct fault_log *log = &device->fault_log;
    if (device->journal.started && atomic_load_explicit(&log->put, memory_order_relaxed) ==
                                       atomic_load_explicit(&log->written, memory_order_relaxed))
        return;
    device_lock(device);
    bool may = may_write(device);
    device_unlock(device);
    if (!may)
        return;
    bool done = write_next(device);
    device->journal.started = true;
    if (!done)
        device_raise(device, WIRE_FAULT_FLASH_ERROR, NO_AXIS, device->journal.newest.sequence);
}

uint32_t fault_log_read(const struct device *device, struct wire_logged_fault faults[JOURNAL_FAULTS])
{
    const struct fault_log *log = &device->fault_log;
    const struct journal *journal = &device->journal;
    uint32_t written = atomic_load_explicit(&log->written, memory_order_relaxed);
    uint32_t waiting = atomic_load_explicit(&log->put, memory_order_relaxed) - written;
    uint32_t kept = journal->fault_count, count = 0;
    if (kept + waiting > JOURNAL_FAULTS)
        kept = JOURNAL_FAULTS - waiting;
    for (uint32_t i = journal->fault_count - kept; i < journal->fault_count; i++)
        faults[count++] = journal->faults[i].fault;
    for (uint32_t i = 0; i < waiting; i++)
        faults[count++] = log->waiting[(written + i) % FAULT_LOG_WAITING];
    return count;
}
