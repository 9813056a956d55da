/* What the device keeps of its own: hard limits, count of its starts, the last faults. An append-only journal in two
 * sectors of flash.
 *
 * Every record is whole in itself: it holds the limits and the power cycle of its time, and a fault if there was one.
 * Of both sectors the whole record (magic, CRC) with the newest sequence number wins. When a sector is full the faults
 * and the new record are copied to the other, which is erased before; the full one stays as it is until the other one
 * is full. So a cut at any moment leaves the old record or the new one.
 *
 * The word that was being written when the power went reads either way, each time anew: a record that was cut in its
 * first word may read as blank, one that was cut in its last as whole. So each start writes a record of what it read,
 * and never uses the place after the last one that was in use. Until a start has written that record, the next one may
 * read the other of the two; a start that cannot write it raises a flash error.
 *
 * Numbers rise by places, those that were passed over too, and by two sectors of them with every start: more than what
 * an earlier start left half written, in either sector, can be ahead by.
 */
#ifndef PHASELEAD_APP_JOURNAL_H
#define PHASELEAD_APP_JOURNAL_H

#include "app/flash_port.h"
#include "app/wire.h"

#define JOURNAL_SECTOR_SIZE 4096 /* of each sector: the time it takes to read them is part of the start */
#define JOURNAL_FAULTS 16

struct journal_fault {
    uint32_t sequence;
    struct wire_logged_fault fault;
};

struct journal {
    struct wire_device_record newest;            /* what holds; its sequence is 0 while nothing is in flash */
    struct journal_fault faults[JOURNAL_FAULTS]; /* oldest first */
    uint32_t fault_count;
    uint32_t next_place;   /* in the sector; see journal_is_full() */
    uint32_t first_number; /* of the sector: a record has this and its place, the copy of a fault its old number */
    uint8_t sector;
    bool started; /* this start's record has been written, or tried to be */
};

/* Reads both sectors, and counts this start: it is written with the first record. */
void journal_boot(struct journal *journal, const struct flash_port *flash);

/* Whether the next record needs an erase, which takes a second, not a millisecond. */
bool journal_is_full(const struct journal *journal);

/* Writes a record: the newest one with these limits, or with this fault added to the log; NULL: as before. False: it
 * could not be written, and what held before still holds. */
bool journal_write(struct journal *journal, const struct flash_port *flash, const struct wire_axis_limits limits[3],
                   const struct wire_logged_fault *fault);

#endif
