#include "app/fault_log.h"

void fault_log_put(struct fault_log *log, struct wire_logged_fault fault)
{
    uint32_t put = atomic_load_explicit(&log->put, memory_order_relaxed);
    if (put - atomic_load_explicit(&log->written, memory_order_acquire) >= FAULT_LOG_WAITING)
        return;
    log->waiting[put % FAULT_LOG_WAITING] = fault;
    atomic_store_explicit(&log->put, put + 1, memory_order_release);
}

uint32_t fault_log_read(const struct fault_log *log, const struct journal *journal,
                        struct wire_logged_fault faults[JOURNAL_FAULTS])
{
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
