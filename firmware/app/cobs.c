#include "app/cobs.h"

#define BLOCK_MAX 0xFF /* a block of 254 bytes that no zero follows */

size_t cobs_encode(const uint8_t *in, size_t size, uint8_t *out)
{
    uint8_t *code_at = out, *to = out + 1;
    uint8_t code = 1;
    for (size_t i = 0; i < size; i++) {
        if (in[i] != 0) {
            *to++ = in[i];
            code++;
        }
        if (in[i] == 0 || (code == BLOCK_MAX && i + 1 < size)) {
            *code_at = code;
            code_at = to++;
            code = 1;
        }
    }
    *code_at = code;
    return (size_t)(to - out);
}

static void restart(struct cobs_decoder *decoder)
{
    decoder->size = 0;
    decoder->left = 0;
    decoder->zero_next = false;
    decoder->started = false;
    decoder->done = false;
    decoder->skipping = false;
}

void cobs_decoder_init(struct cobs_decoder *decoder, uint8_t *buffer, size_t capacity)
{
    decoder->buffer = buffer;
    decoder->capacity = capacity;
    restart(decoder);
}

static void append(struct cobs_decoder *decoder, uint8_t byte)
{
    if (decoder->size < decoder->capacity)
        decoder->buffer[decoder->size++] = byte;
    else
        decoder->skipping = true;
}

static enum cobs_event delimiter(struct cobs_decoder *decoder)
{
    bool whole = decoder->started && !decoder->skipping && decoder->left == 0;
    bool lost = decoder->started && !whole;
    size_t size = decoder->size;
    restart(decoder);
    if (!whole)
        return lost ? COBS_ERROR : COBS_NOTHING;
    decoder->size = size;
    decoder->done = true;
    return COBS_FRAME;
}

enum cobs_event cobs_decoder_push(struct cobs_decoder *decoder, uint8_t byte)
{
    if (decoder->done)
        restart(decoder);
    if (byte == 0)
        return delimiter(decoder);
    decoder->started = true;
    if (decoder->skipping)
        return COBS_NOTHING;
    if (decoder->left > 0) {
        decoder->left--;
        append(decoder, byte);
        return COBS_NOTHING;
    }
    if (decoder->zero_next)
        append(decoder, 0);
    decoder->left = (uint8_t)(byte - 1);
    decoder->zero_next = byte != BLOCK_MAX;
    return COBS_NOTHING;
}
