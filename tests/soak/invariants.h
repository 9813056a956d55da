/* What holds of a device whatever its host, its sensors and its faults do: checked from one moment to the next, by
 * rules written here once more, not by the device's own tables. A breach is said on stderr and ends the program.
 */
#ifndef PHASELEAD_SOAK_INVARIANTS_H
#define PHASELEAD_SOAK_INVARIANTS_H

#include "app/device.h"

struct invariants {
    uint64_t tick;
    uint32_t state, fault;
    int32_t u_q24[AXES];
    uint16_t dac_codes[AXES];
    bool was_armed;                    /* since the last reset */
    bool goes_to_zero;                 /* parked: an update wants 0 V, which may not be the safe value */
    bool on_way_home;                  /* every output ramps to its safe value, or is there */
    uint64_t faults, longest_way_home; /* ticks */
    uint64_t fault_ticks;              /* since the fault, on the way home */
};

/* The device has just been reset. */
void invariants_reset(struct invariants *seen, const struct device *device);

/* After one tick. */
void invariants_after_tick(struct invariants *seen, const struct device *device);

/* After one command was taken from the line; `type`: enum wire_type of the one that was carried out, 0: none was. */
void invariants_after_command(struct invariants *seen, const struct device *device, uint8_t type);

#endif
