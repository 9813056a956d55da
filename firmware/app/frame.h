/* Frames of the wire: COBS( header payload crc32 ) 0x00. */
#ifndef PHASELEAD_APP_FRAME_H
#define PHASELEAD_APP_FRAME_H

#include "app/cobs.h"
#include "app/wire.h"

/* Most bytes of a frame on the line, delimiter included. */
#define FRAME_MAX (COBS_ENCODED_MAX(WIRE_MAX_BODY) + 1)

/* Seals the `payload_size` bytes that lie at body + WIRE_HEADER_SIZE (body: WIRE_MAX_BODY bytes): writes the header
 * before and the CRC behind them, and the encoded frame with its delimiter to `frame` (FRAME_MAX bytes). Returns the
 * frame's length, or 0 when the payload is too long. */
size_t frame_seal(const struct wire_header *header, uint8_t *body, size_t payload_size, uint8_t *frame);

/* Opens a decoded frame. False when its length or CRC is wrong; `payload` points into `body`. */
bool frame_open(const uint8_t *body, size_t size, struct wire_header *header, const uint8_t **payload,
                size_t *payload_size);

#endif
