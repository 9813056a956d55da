/* A day's work of a device with a host that behaves: three axes in closed loop, a stream, moves one after another. */
#ifndef PHASELEAD_SOAK_DAY_H
#define PHASELEAD_SOAK_DAY_H

/* Runs so many hours of device time, across the tick at which 32 bits are full, and prints what was seen. Aborts where
 * an invariant breaks, a command is refused, a fault is met, or a stream loses a tick. */
void day_run(double hours);

#endif
