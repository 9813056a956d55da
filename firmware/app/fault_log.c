#include "app/fault_log.h"

#define SEED 0x314B4C46u /* 'FLK1' */
#define FACTOR 0x9E3779B1u

/* `number`: of the fault since the memory was last forgotten, so that one that was written long ago does not count. */
static uint32_t check_of(uint32_t number, const struct wire_logged_fault *fault)
{
    const uint32_t words[] = {fault->power_cycle, (uint32_t)fault->tick, (uint32_t)(fault->tick >> 32), fault->detail,
                              fault->fault | (uint32_t)fault->axis << 8 | (uint32_t)fault->state << 16};
    uint32_t check = SEED + number;
#pragma GCC unroll 5
    for (unsigned i = 0; i < sizeof words / sizeof words[0]; i++) {
        check = (check ^ words[i]) * FACTOR;
        check = check >> 16 | check << 16;
    }
    return check;
}

static bool is_in_journal(const struct journal *journal, const struct wire_logged_fault *fault)
{
#pragma GCC unroll 1 /* else 16 times over, as those below */
    for (uint32_t i = 0; i < journal->fault_count; i++) {
        const struct wire_logged_fault *one = &journal->faults[i].fault;
        if (one->power_cycle == fault->power_cycle && one->tick == fault->tick && one->fault == fault->fault)
            return true;
    }
    return false;
}

/* The number after the last of those that waited. */
static uint32_t end_of_whole(const struct fault_log *log)
{
    uint32_t end = log->written;
#pragma GCC unroll 1
    for (uint32_t i = 0; i < FAULT_LOG_WAITING; i++) {
        if (end == log->put ||
            log->checks[end % FAULT_LOG_WAITING] != check_of(end, &log->waiting[end % FAULT_LOG_WAITING]))
            break;
        end++;
    }
    return end;
}

void fault_log_boot(struct fault_log *log, struct journal *journal)
{
    uint32_t first = log->written, end = end_of_whole(log);
    /* The reset may have come after it was written, and before that was noted. */
    while (first != end && is_in_journal(journal, &log->waiting[first % FAULT_LOG_WAITING]))
        first++;
    if (end - first == FAULT_LOG_WAITING)
        first++; /* room for one of this start */
    if (first != end) {
        uint32_t power_cycle = log->waiting[(end - 1) % FAULT_LOG_WAITING].power_cycle;
        if (power_cycle - journal->newest.power_cycle < FAULT_LOG_WAITING)
            journal->newest.power_cycle = power_cycle + 1;
    }
    log->written = first;
    log->put = end;
}

void fault_log_put(struct fault_log *log, struct wire_logged_fault fault)
{
    uint32_t put = atomic_load_explicit(&log->put, memory_order_relaxed);
    if (put - atomic_load_explicit(&log->written, memory_order_acquire) >= FAULT_LOG_WAITING)
        return;
    log->waiting[put % FAULT_LOG_WAITING] = fault;
    log->checks[put % FAULT_LOG_WAITING] = check_of(put, &fault);
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
#pragma GCC unroll 1
    for (uint32_t i = journal->fault_count - kept; i < journal->fault_count; i++)
        faults[count++] = journal->faults[i].fault;
    for (uint32_t i = 0; i < waiting; i++)
        faults[count++] = log->waiting[(written + i) % FAULT_LOG_WAITING];
    return count;
}
