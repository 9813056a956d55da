/* The fault log: the faults of this start and those before it. A fault waits in memory until it can be written: that
 * keeps ticks out, so it is done when nothing moves and nothing is recorded.
 *
 * A reset leaves this memory as it is, so that what waited then is written at the next start. What it holds after a
 * loss of power is anything: each fault has a check, and none of it counts where that is wrong.
 */
#ifndef PHASELEAD_APP_FAULT_LOG_H
#define PHASELEAD_APP_FAULT_LOG_H

#include <stdatomic.h>

#include "app/journal.h"

#define FAULT_LOG_WAITING JOURNAL_FAULTS

struct fault_log {
    struct wire_logged_fault waiting[FAULT_LOG_WAITING];
    uint32_t checks[FAULT_LOG_WAITING];
    _Atomic uint32_t put, written;
};

/* After a reset and journal_boot(): of what is there, keeps the faults that waited and are not in the journal. This
 * start counts as a later one than theirs, also if those never came to be written. */
void fault_log_boot(struct fault_log *log, struct journal *journal);

/* A fault was latched; its reaction has not begun yet. */
void fault_log_put(struct fault_log *log, struct wire_logged_fault fault);

/* The newest JOURNAL_FAULTS of all, oldest first; gives their number. */
uint32_t fault_log_read(const struct fault_log *log, const struct journal *journal,
                        struct wire_logged_fault faults[JOURNAL_FAULTS]);

#endif
