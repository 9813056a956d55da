/* Firmware over the wire: into the image slot that does not run, put on trial, confirmed by the host that has read its
 * build id. While it is on trial the device cannot be armed, and it restarts when it is not confirmed in time.
 */
#ifndef PHASELEAD_APP_UPDATE_H
#define PHASELEAD_APP_UPDATE_H

#include "app/boot_record.h"
#include "app/wire.h"

#define UPDATE_TRIAL_TICKS 50000u /* 10 s */
#define UPDATE_RESTART_TICKS 100u /* 20 ms: the reply is on its way first, at 115200 baud too */

/* What a port says of its images. */
struct update_port {
    struct flash_port flash; /* slots: enum image_flash_slot */
    struct boot_places places;
    uint8_t slot;  /* that runs */
    bool on_trial; /* says who started it */
};

struct update {
    struct image_header header; /* of the image that is being received; programmed last */
    struct boot_record record;
    uint64_t restart_tick;
    bool receiving;
    bool on_trial;
    bool rolled_back; /* the image in the other slot was on trial, and was not started */
    bool restarting;
};

void update_init(struct update *update, const struct update_port *port);

/* Once ticks run, since it takes a while: reads the boot record, and see boot_record_settle(). */
void update_read_record(struct update *update, const struct update_port *port);

/* The port is to reset the chip now. */
bool update_restart_is_due(const struct update *update, uint64_t tick);

#endif
