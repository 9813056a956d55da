#include "app/boot_record.h"

#include <string.h>

#include "app/crc32.h"

#define ENTRY_MAGIC 0x4C42u /* "BL", above kind and slot */
#define APPEND_TRIES 4u
#define ENTRIES_AT_ONCE 8u

/* Little-endian in flash, as the processor has it. */
struct entry {
    uint32_t what; /* ENTRY_MAGIC << 16 | kind << 8 | slot */
    uint32_t image_crc;
    uint32_t zero;
    uint32_t crc; /* of what is before it */
};
_Static_assert(sizeof(struct entry) == BOOT_ENTRY_SIZE, "an entry is padded");

static uint32_t entry_crc(const struct entry *entry)
{
    return crc32(0, (const uint8_t *)entry, offsetof(struct entry, crc));
}

static bool is_blank(const struct entry *entry)
{
    return (entry->what & entry->image_crc & entry->zero & entry->crc) == UINT32_MAX;
}

static bool is_entry(const struct entry *entry)
{
    return entry->what >> 16 == ENTRY_MAGIC && (entry->what & 0xFFu) < IMAGE_SLOTS && entry->crc == entry_crc(entry);
}

static void take(struct boot_record *record, const struct entry *entry)
{
    uint8_t slot = (uint8_t)entry->what;
    switch (entry->what >> 8 & 0xFFu) {
    case BOOT_TRIAL:
        record->trial = slot;
        record->trial_crc = entry->image_crc;
        record->attempts = 0;
        break;
    case BOOT_ATTEMPT:
        if (slot == record->trial && entry->image_crc == record->trial_crc)
            record->attempts++;
        break;
    case BOOT_CONFIRMED:
        record->settled = record->confirmed == slot && record->trial == BOOT_NO_SLOT;
        record->confirmed = slot;
        record->trial = BOOT_NO_SLOT;
        break;
    default:
        break;
    }
}

/* Not up to the first blank place, but to the end: one that was barely begun may read as blank. */
void boot_record_read(const struct flash_port *flash, struct boot_record *record)
{
    *record = (struct boot_record){.confirmed = BOOT_NO_SLOT, .trial = BOOT_NO_SLOT};
    for (uint32_t at = 0; at < BOOT_RECORD_SIZE; at += BOOT_ENTRY_SIZE * ENTRIES_AT_ONCE) {
        struct entry entries[ENTRIES_AT_ONCE];
        flash->read(flash->context, BOOT_RECORD_SLOT, at, (uint8_t *)entries, sizeof entries);
        for (unsigned i = 0; i < ENTRIES_AT_ONCE; i++) {
            if (is_blank(&entries[i]))
                continue;
            record->end = at + (i + 1) * BOOT_ENTRY_SIZE;
            if (is_entry(&entries[i]))
                take(record, &entries[i]);
        }
    }
}

bool boot_record_append(const struct flash_port *flash, struct boot_record *record, enum boot_entry_kind kind,
                        unsigned slot, uint32_t image_crc)
{
    struct entry entry = {.what = ENTRY_MAGIC << 16 | (uint32_t)kind << 8 | slot, .image_crc = image_crc};
    entry.crc = entry_crc(&entry);
    for (unsigned tries = 0; tries < APPEND_TRIES && record->end < BOOT_RECORD_SIZE; tries++) {
        uint32_t at = record->end;
        record->end += BOOT_ENTRY_SIZE;
        if (flash_program_verified(flash, BOOT_RECORD_SLOT, at, (const uint8_t *)&entry, sizeof entry)) {
            take(record, &entry);
            return true;
        }
    }
    return false;
}

bool boot_record_settle(const struct flash_port *flash, struct boot_record *record)
{
    if (record->confirmed == BOOT_NO_SLOT || record->trial != BOOT_NO_SLOT || record->settled)
        return true;
    return boot_record_append(flash, record, BOOT_CONFIRMED, record->confirmed, 0);
}

bool boot_record_needs_room(const struct boot_record *record)
{
    return BOOT_RECORD_SIZE - record->end < BOOT_ENTRIES_SPARE * BOOT_ENTRY_SIZE;
}

static bool whole(const struct flash_port *flash, const struct boot_places *places, image_crc_function *crc,
                  unsigned slot, struct boot_choice *choice)
{
    choice->slot = slot;
    return image_is_whole(flash, slot, places->address[slot], places->slot_size, crc, &choice->header);
}

void boot_choose(const struct flash_port *flash, const struct boot_places *places, image_crc_function *crc,
                 struct boot_choice *choice)
{
    struct boot_record record;
    boot_record_read(flash, &record);
    choice->trial = record.trial != BOOT_NO_SLOT && record.attempts < BOOT_ATTEMPTS &&
                    whole(flash, places, crc, record.trial, choice) && choice->header.crc == record.trial_crc &&
                    boot_record_append(flash, &record, BOOT_ATTEMPT, record.trial, record.trial_crc);
    if (choice->trial)
        return;
    unsigned first = record.confirmed != BOOT_NO_SLOT ? record.confirmed : record.trial == IMAGE_SLOT_A;
    if (!whole(flash, places, crc, first, choice) && !whole(flash, places, crc, 1 - first, choice))
        choice->slot = BOOT_NO_SLOT;
}
