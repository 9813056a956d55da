/* The fault log: the faults of this start and those before it. A fault waits in memory until it can be written: that
 * keeps ticks out, so it is done when nothing moves and nothing is recorded.
 */
#ifndef PHASELEAD_APP_FAULT_LOG_H
#define PHASELEAD_APP_FAULT_LOG_H

#include <stdatomic.h>

#include "app/journal.h"

#define FAULT_LOG_WAITING 4

struct device;

struct fault_log {
    struct wire_logged_fault waiting[FAULT_LOG_WAITING];
    _Atomic uint32_t put, written;
};

/* A fault was latched; its reaction has not begun yet. */
void fault_log_put(struct device *device);

/* For a port's main loop, outside of the tick: writes to the journal what is due, when it may. */
void fault_log_write(struct device *device);

/* The newest JOURNAL_FAULTS of all, oldest first; gives their number. */
uint32_t fault_log_read(const struct device *device, struct wire_logged_fault faults[JOURNAL_FAULTS]);

#endif
