/* The fault log: the faults of this start and those before it. A fault waits in memory until it can be written: that
 * keeps ticks out, so it is done when nothing moves and nothing is recorded.
 */
#ifndef PHASELEAD_APP_FAULT_LOG_H
#define PHASELEAD_APP_FAULT_LOG_H

#include <stdatomic.h>

#include "app/journal.h"

#define FAULT_LOG_WAITING 4

struct fault_log {
    struct wire_logged_fault waiting[FAULT_LOG_WAITING];
    _Atomic uint32_t put, written;
};

/* A fault was latched; its reaction has not begun yet. */
void fault_log_put(struct fault_log *log, struct wire_logged_fault fault);

/* The newest JOURNAL_FAULTS of all, oldest first; gives their number. */
uint32_t fault_log_read(const struct fault_log *log, const struct journal *journal,
                        struct wire_logged_fault faults[JOURNAL_FAULTS]);

#endif
