/* Which image is to run. Entries are appended to a sector of their own: an image is put on trial, each start of it is
 * noted, and it is confirmed once a host has spoken with it. An image that is not confirmed after BOOT_ATTEMPTS starts
 * is given up for the one before.
 *
 * Every entry has its own CRC, so one that was cut short is none. The power may go at any time: before an entry is
 * whole the decision is the old one, and both images are whole whenever there are two to decide between.
 */
#ifndef PHASELEAD_APP_BOOT_RECORD_H
#define PHASELEAD_APP_BOOT_RECORD_H

#include "app/image.h"

#define BOOT_ATTEMPTS 3u
#define BOOT_RECORD_SIZE 0x4000u
#define BOOT_ENTRY_SIZE 16u
/* An update takes five entries, and a few more when the power goes meanwhile. With fewer left the sector is erased. */
#define BOOT_ENTRIES_SPARE 32u
#define BOOT_NO_SLOT 255u

enum boot_entry_kind { BOOT_TRIAL = 1, BOOT_ATTEMPT, BOOT_CONFIRMED };

struct boot_record {
    uint32_t end;       /* offset behind the last place that is not blank */
    uint8_t confirmed;  /* slot; BOOT_NO_SLOT */
    uint8_t trial;      /* slot, as long as it is neither confirmed nor superseded; BOOT_NO_SLOT */
    uint8_t attempts;   /* starts of the image on trial */
    bool settled;       /* the last confirmation stands twice */
    uint32_t trial_crc; /* of the image's header */
};

void boot_record_read(const struct flash_port *flash, struct boot_record *record);

/* Appends an entry and sees that it is there. False when the flash does not take it or the sector is full. */
bool boot_record_append(const struct flash_port *flash, struct boot_record *record, enum boot_entry_kind kind,
                        unsigned slot, uint32_t image_crc);

/* A confirmation that was cut short may read as whole today and as none tomorrow: what was read as whole is written
 * again. To be called once a start. */
bool boot_record_settle(const struct flash_port *flash, struct boot_record *record);

bool boot_record_needs_room(const struct boot_record *record);

struct boot_places {
    uint32_t address[IMAGE_SLOTS];
    uint32_t slot_size;
};

struct boot_choice {
    unsigned slot; /* BOOT_NO_SLOT: there is no whole image */
    bool trial;
    struct image_header header;
};

/* What to start: an image on trial that has attempts left, and notes this one; else the confirmed one; else any that is
 * whole. */
void boot_choose(const struct flash_port *flash, const struct boot_places *places, image_crc_function *crc,
                 struct boot_choice *choice);

#endif
