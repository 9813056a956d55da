#include "app/model_store.h"

#include <string.h>

#include "app/crc32.h"
#include "app/model_check.h"

/* A flash record: magic, sequence, size of the blob, CRC over sequence, size and blob; then the blob; then a mark,
 * blank until a later save begins. */
#define RECORD_MAGIC 0x52304C50u
#define RECORD_HEADER_SIZE 16
#define MARK_OFFSET (RECORD_HEADER_SIZE + WIRE_MODEL_SIZE)
#define MARK_SIZE 4

enum record_kind { RECORD_BLANK, RECORD_TORN, RECORD_WHOLE };

const struct model_slot *model_store_active(const struct model_store *store)
{
    return store->loaded ? &store->slots[store->active] : NULL;
}

const struct model_slot *model_store_prepared(const struct model_store *store)
{
    return &store->slots[1 - store->active];
}

static struct model_slot *shadow(struct model_store *store)
{
    return &store->slots[1 - store->active];
}

enum wire_status model_store_begin(struct model_store *store, uint32_t size, uint32_t crc)
{
    store->uploading = false;
    if (size != WIRE_MODEL_SIZE)
        return WIRE_STATUS_BAD_VALUE;
    store->uploading = true;
    store->promised_crc = crc;
    memset(shadow(store)->blob, 0, WIRE_MODEL_SIZE);
    return WIRE_STATUS_OK;
}

enum wire_status model_store_chunk(struct model_store *store, uint32_t offset, const uint8_t *data, size_t size)
{
    if (!store->uploading)
        return WIRE_STATUS_WRONG_STATE;
    if (size == 0 || offset >= WIRE_MODEL_SIZE || size > WIRE_MODEL_SIZE - offset)
        return WIRE_STATUS_BAD_VALUE;
    memcpy(shadow(store)->blob + offset, data, size);
    return WIRE_STATUS_OK;
}

enum wire_status model_store_prepare(struct model_store *store, uint16_t *invalid_field)
{
    struct model_slot *slot = shadow(store);
    *invalid_field = 0;
    if (!store->uploading)
        return WIRE_STATUS_WRONG_STATE;
    store->uploading = false;
    slot->crc = crc32(0, slot->blob, WIRE_MODEL_SIZE);
    if (slot->crc != store->promised_crc)
        return WIRE_STATUS_CRC_MISMATCH;
    *invalid_field = model_expand(slot, &store->room);
    return *invalid_field == 0 ? WIRE_STATUS_OK : WIRE_STATUS_MODEL_INVALID;
}

void model_store_swap(struct model_store *store)
{
    const struct model_slot *slot = shadow(store);
    /* After a fallback the same model still has to be saved again, to repair the other flash slot. */
    bool same = store->loaded && slot->crc == store->slots[store->active].crc;
    store->persisted = store->persisted && same && !store->fallback;
    store->active = 1 - store->active;
    store->loaded = true;
    store->fallback = false;
}

static uint32_t get_u32(const uint8_t *in)
{
    return in[0] | (uint32_t)in[1] << 8 | (uint32_t)in[2] << 16 | (uint32_t)in[3] << 24;
}

static void put_u32(uint8_t *out, uint32_t value)
{
    for (unsigned i = 0; i < 4; i++)
        out[i] = (uint8_t)(value >> 8 * i);
}

static uint32_t record_crc(uint32_t sequence, const uint8_t *blob)
{
    uint8_t head[8];
    put_u32(head, sequence);
    put_u32(head + 4, WIRE_MODEL_SIZE);
    return crc32(crc32(0, head, sizeof head), blob, WIRE_MODEL_SIZE);
}

static bool is_blank(const uint8_t *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++)
        if (bytes[i] != 0xFF)
            return false;
    return true;
}

/* Reads a flash slot into a RAM slot, but for the blob's own CRC. Whole: header and CRC hold. */
static enum record_kind read_record(const struct flash_port *flash, unsigned at, struct model_slot *to,
                                    uint32_t *sequence)
{
    uint8_t head[RECORD_HEADER_SIZE];
    flash->read(flash->context, at, 0, head, sizeof head);
    flash->read(flash->context, at, RECORD_HEADER_SIZE, to->blob, WIRE_MODEL_SIZE);
    if (is_blank(head, sizeof head) && is_blank(to->blob, WIRE_MODEL_SIZE))
        return RECORD_BLANK;
    *sequence = get_u32(head + 4);
    if (get_u32(head) != RECORD_MAGIC || *sequence == 0 || get_u32(head + 8) != WIRE_MODEL_SIZE ||
        get_u32(head + 12) != record_crc(*sequence, to->blob))
        return RECORD_TORN;
    return RECORD_WHOLE;
}

/* Not whether the other slot holds a record: that may be an older one, which has gone bad. */
static bool is_marked(const struct flash_port *flash, unsigned at)
{
    uint8_t there[MARK_SIZE];
    flash->read(flash->context, at, MARK_OFFSET, there, sizeof there);
    return !is_blank(there, sizeof there);
}

static bool mark(const struct flash_port *flash, unsigned at)
{
    const uint8_t marked[MARK_SIZE] = {0};
    return flash_program_verified(flash, at, MARK_OFFSET, marked, sizeof marked);
}

/* FLASH_SLOTS when there is none. */
static unsigned newest_whole(const enum record_kind kind[FLASH_SLOTS], const uint32_t sequence[FLASH_SLOTS])
{
    if (kind[0] != RECORD_WHOLE)
        return kind[1] == RECORD_WHOLE ? 1 : FLASH_SLOTS;
    return kind[1] == RECORD_WHOLE && (int32_t)(sequence[1] - sequence[0]) > 0 ? 1 : 0;
}

/* Of the records that are also of use; FLASH_SLOTS when there is none. Expanding is what takes time: only the one that
 * is used is, unless it turns out to be of none. */
static unsigned newest_usable(struct model_store *store, enum record_kind kind[FLASH_SLOTS],
                              const uint32_t sequence[FLASH_SLOTS])
{
    unsigned newest;
    while ((newest = newest_whole(kind, sequence)) != FLASH_SLOTS &&
           model_expand(&store->slots[newest], &store->room) != 0)
        kind[newest] = RECORD_TORN;
    return newest;
}

void model_store_boot(struct model_store *store, const struct flash_port *flash)
{
    uint32_t sequence[FLASH_SLOTS] = {0, 0};
    enum record_kind kind[FLASH_SLOTS];
    memset(store, 0, sizeof *store);
    for (unsigned i = 0; i < FLASH_SLOTS; i++)
        kind[i] = read_record(flash, i, &store->slots[i], &sequence[i]);
    unsigned newest = newest_usable(store, kind, sequence);
    if (newest == FLASH_SLOTS) {
        store->littered = kind[0] != RECORD_BLANK || kind[1] != RECORD_BLANK;
        return;
    }
    store->slots[newest].crc = crc32(0, store->slots[newest].blob, WIRE_MODEL_SIZE);
    store->active = (uint8_t)newest;
    store->newest_slot = (uint8_t)newest;
    store->sequence = sequence[newest];
    store->loaded = true;
    store->persisted = true;
    store->fallback = is_marked(flash, newest);
}

enum wire_status model_store_persist(struct model_store *store, const struct flash_port *flash, uint32_t *sequence)
{
    *sequence = store->sequence;
    if (!store->loaded)
        return WIRE_STATUS_NO_MODEL;
    if (store->persisted && !store->fallback)
        return WIRE_STATUS_OK; /* it is there already: no erase for nothing */
    const struct model_slot *slot = &store->slots[store->active];
    unsigned at = store->sequence == 0 ? 0 : 1u - store->newest_slot;
    uint32_t next = store->sequence == UINT32_MAX ? 1 : store->sequence + 1;
    uint8_t head[RECORD_HEADER_SIZE];
    put_u32(head, RECORD_MAGIC);
    put_u32(head + 4, next);
    put_u32(head + 8, WIRE_MODEL_SIZE);
    put_u32(head + 12, record_crc(next, slot->blob));
    if (store->littered && !flash->erase(flash->context, 1 - at)) /* or it may yet read as a record, and as the newer */
        return WIRE_STATUS_FLASH_FAILED;
    store->littered = false;
    if (store->sequence != 0 && !mark(flash, store->newest_slot))
        return WIRE_STATUS_FLASH_FAILED;
    if (!flash->erase(flash->context, at) ||
        !flash_program_verified(flash, at, RECORD_HEADER_SIZE, slot->blob, WIRE_MODEL_SIZE) ||
        !flash_program_verified(flash, at, 0, head, sizeof head))
        return WIRE_STATUS_FLASH_FAILED;
    store->newest_slot = (uint8_t)at;
    store->sequence = next;
    store->persisted = true;
    store->fallback = false;
    *sequence = next;
    return WIRE_STATUS_OK;
}
