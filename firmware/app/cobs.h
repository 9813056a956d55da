/* Consistent overhead byte stuffing (Cheshire & Baker 1999): a body without zero bytes, so that zero can end a frame.
 */
#ifndef PHASELEAD_APP_COBS_H
#define PHASELEAD_APP_COBS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Most bytes that `size` bytes become, delimiter not included. */
#define COBS_ENCODED_MAX(size) ((size) + (size) / 254 + 1)

/* Encodes into `out`, which must hold COBS_ENCODED_MAX(size) bytes. Returns the bytes written; no delimiter. */
size_t cobs_encode(const uint8_t *in, size_t size, uint8_t *out);

enum cobs_event { COBS_NOTHING, COBS_FRAME, COBS_ERROR };

/* Takes the line byte by byte into the caller's buffer and never writes beyond it. After noise or an overlong frame it
 * skips to the next delimiter. */
struct cobs_decoder {
    uint8_t *buffer;
    size_t capacity;
    size_t size;    /* bytes decoded; of the whole frame when COBS_FRAME was returned, until the next push */
    uint8_t left;   /* bytes left in the current block */
    bool zero_next; /* the block ended where the sender took a zero out, if another block follows */
    bool started;   /* something came after the last delimiter */
    bool done;      /* the last push returned a frame */
    bool skipping;  /* this frame is lost; reported already, or when its delimiter comes */
};

void cobs_decoder_init(struct cobs_decoder *decoder, uint8_t *buffer, size_t capacity);

/* COBS_FRAME: buffer[0 .. size) is a frame. COBS_ERROR: a frame was lost; once per frame, at its delimiter. Delimiters
 * that follow each other are nothing. */
enum cobs_event cobs_decoder_push(struct cobs_decoder *decoder, uint8_t byte);

#endif
