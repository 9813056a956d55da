#include "app/journal.h"

#include <string.h>

#include "app/crc32.h"

#define MAGIC 0x314A4850u
#define CRC_SIZE 4
#define RECORD_SIZE (WIRE_DEVICE_RECORD_SIZE + CRC_SIZE)
#define PLACES (JOURNAL_SECTOR_SIZE / RECORD_SIZE)
#define TRIES 4 /* a place that cannot be written is passed over */

_Static_assert(PLACES > 2 * (JOURNAL_FAULTS + 1), "a sector must hold more than what is copied to it");

static const struct wire_axis_limits NO_LIMITS = {
    .dac_min = 0, .dac_max = UINT16_MAX, .slew_codes_q16 = UINT32_MAX, .adc_min = 0, .adc_max = UINT16_MAX};

static bool is_newer(uint32_t a, uint32_t b)
{
    return (int32_t)(a - b) > 0;
}

/* By words: a start looks at every place of both sectors. */
static bool is_blank(const uint8_t bytes[RECORD_SIZE])
{
#pragma GCC unroll 18
    for (size_t i = 0; i < RECORD_SIZE; i += sizeof(uint32_t)) {
        uint32_t word;
        memcpy(&word, bytes + i, sizeof word);
        if (word != UINT32_MAX)
            return false;
    }
    return true;
}

static void pack(const struct wire_device_record *record, uint8_t bytes[RECORD_SIZE])
{
    wire_pack_device_record(record, bytes, WIRE_DEVICE_RECORD_SIZE);
    uint32_t crc = crc32(0, bytes, WIRE_DEVICE_RECORD_SIZE);
    for (unsigned i = 0; i < CRC_SIZE; i++)
        bytes[WIRE_DEVICE_RECORD_SIZE + i] = (uint8_t)(crc >> 8 * i);
}

static bool unpack(struct wire_device_record *record, const uint8_t bytes[RECORD_SIZE])
{
    uint32_t crc = crc32(0, bytes, WIRE_DEVICE_RECORD_SIZE);
    for (unsigned i = 0; i < CRC_SIZE; i++)
        if (bytes[WIRE_DEVICE_RECORD_SIZE + i] != (uint8_t)(crc >> 8 * i))
            return false;
    wire_unpack_device_record(record, bytes, WIRE_DEVICE_RECORD_SIZE);
    return record->magic == MAGIC && record->sequence != 0;
}

/* Keeps the newest, in their order, each once: the copy of a fault has the number of the original. */
static void add_fault(struct journal *journal, uint32_t sequence, const struct wire_logged_fault *fault)
{
    uint32_t at = journal->fault_count;
    while (at > 0 && is_newer(journal->faults[at - 1].sequence, sequence))
        at--;
    if (at > 0 && journal->faults[at - 1].sequence == sequence)
        return;
    if (journal->fault_count == JOURNAL_FAULTS) {
        if (at == 0)
            return;
        at--;
        memmove(journal->faults, journal->faults + 1, at * sizeof journal->faults[0]);
    } else {
        memmove(journal->faults + at + 1, journal->faults + at,
                (journal->fault_count - at) * sizeof journal->faults[0]);
        journal->fault_count++;
    }
    journal->faults[at] = (struct journal_fault){sequence, *fault};
}

/* Of a record and its copy in the other sector, which have one number, either will do. */
static void take(struct journal *journal, const struct wire_device_record *record, unsigned sector, uint32_t place)
{
    if (record->fault[0].fault != WIRE_FAULT_NONE)
        add_fault(journal, record->sequence, &record->fault[0]);
    const uint32_t newest = journal->newest.sequence, newest_place = newest - journal->first_number;
    if (newest != 0 && !is_newer(record->sequence, newest) && (record->sequence != newest || place < newest_place))
        return;
    journal->newest = *record;
    journal->sector = (uint8_t)sector;
    journal->first_number = record->sequence - place;
}

/* Returns the number of places up to the last that is in use. */
static uint32_t read_sector(struct journal *journal, const struct flash_port *flash, unsigned sector)
{
    uint32_t used = 0;
    for (uint32_t place = 0; place < PLACES; place++) {
        _Alignas(uint32_t) uint8_t bytes[RECORD_SIZE];
        struct wire_device_record record;
        flash->read(flash->context, sector, place * RECORD_SIZE, bytes, sizeof bytes);
        if (is_blank(bytes))
            continue;
        used = place + 1;
        if (unpack(&record, bytes))
            take(journal, &record, sector, place);
    }
    return used;
}

/* Nothing whole is there. What a first write leaves that was cut is one place of sector 0; anything more was a journal
 * once, and its limits are lost. What is left of it counts as a full sector: it stays until the new record is whole in
 * the other one. */
static void begin_anew(struct journal *journal, const uint32_t used[FLASH_SLOTS])
{
    for (unsigned axis = 0; axis < 3; axis++)
        journal->newest.limits[axis] = NO_LIMITS;
    journal->newest.magic = MAGIC;
    journal->newest.limits_lost = used[0] > 1 || used[1] > 0;
    journal->first_number = 1;
    if (used[0] == 0 && used[1] == 0)
        return;
    journal->sector = used[1] > 0 || used[0] <= 1 ? 1 : 0;
    journal->next_place = PLACES;
}

void journal_boot(struct journal *journal, const struct flash_port *flash)
{
    uint32_t used[FLASH_SLOTS];
    memset(journal, 0, sizeof *journal);
    for (unsigned sector = 0; sector < FLASH_SLOTS; sector++)
        used[sector] = read_sector(journal, flash, sector);
    if (journal->newest.sequence == 0) {
        begin_anew(journal, used);
    } else {
        journal->next_place = used[journal->sector] + 1; /* one is left out */
        journal->first_number += 2 * PLACES;             /* what a start before left half written, in either sector */
    }
    journal->newest.fault[0] = (struct wire_logged_fault){0};
    journal->newest.power_cycle++;
}

bool journal_is_full(const struct journal *journal)
{
    return journal->next_place >= PLACES;
}

static bool put(struct journal *journal, const struct flash_port *flash, const struct wire_device_record *record)
{
    uint8_t bytes[RECORD_SIZE];
    pack(record, bytes);
    for (unsigned i = 0; i < TRIES && !journal_is_full(journal); i++)
        if (flash_program_verified(flash, journal->sector, journal->next_place++ * RECORD_SIZE, bytes, sizeof bytes))
            return true;
    return false;
}

/* To the other sector, with the faults. They keep their numbers, so that a copy never wins over the original; should
 * it be all that is left, it has the limits that hold. */
static bool move_on(struct journal *journal, const struct flash_port *flash)
{
    struct wire_device_record copy = journal->newest;
    journal->sector = 1 - journal->sector;
    journal->next_place = 0;
    journal->first_number += PLACES;
    if (!flash->erase(flash->context, journal->sector))
        return false;
    for (uint32_t i = 0; i < journal->fault_count; i++) {
        copy.sequence = journal->faults[i].sequence;
        copy.fault[0] = journal->faults[i].fault;
        if (!put(journal, flash, &copy))
            return false;
    }
    return true;
}

static bool number_and_put(struct journal *journal, const struct flash_port *flash, struct wire_device_record *record)
{
    if (journal->first_number + journal->next_place == 0) /* no number */
        journal->next_place++;
    record->sequence = journal->first_number + journal->next_place;
    return put(journal, flash, record);
}

static bool append(struct journal *journal, const struct flash_port *flash, struct wire_device_record *record)
{
    if (!journal_is_full(journal) && number_and_put(journal, flash, record))
        return true;
    const uint8_t full = journal->sector;
    const uint32_t first_number = journal->first_number;
    if (move_on(journal, flash) && number_and_put(journal, flash, record))
        return true;
    journal->sector = full; /* again from there: it holds everything */
    journal->first_number = first_number;
    journal->next_place = PLACES;
    return false;
}

bool journal_write(struct journal *journal, const struct flash_port *flash, const struct wire_axis_limits limits[3],
                   const struct wire_logged_fault *fault)
{
    struct wire_device_record record = journal->newest;
    record.fault[0] = fault ? *fault : (struct wire_logged_fault){0};
    if (limits) {
        memcpy(record.limits, limits, sizeof record.limits);
        record.limits_lost = 0;
    }
    if (!append(journal, flash, &record))
        return false;
    if (fault)
        add_fault(journal, record.sequence, fault);
    journal->newest = record;
    journal->newest.fault[0] = (struct wire_logged_fault){0};
    journal->started = true;
    return true;
}
