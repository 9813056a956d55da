#include "app/frame.h"

#include "app/crc32.h"

size_t frame_seal(const struct wire_header *header, uint8_t *body, size_t payload_size, uint8_t *frame)
{
    if (payload_size > WIRE_MAX_PAYLOAD)
        return 0;
    size_t size = WIRE_HEADER_SIZE + payload_size;
    wire_pack_header(header, body, WIRE_HEADER_SIZE);
    uint32_t crc = crc32(0, body, size);
    for (unsigned i = 0; i < WIRE_CRC_SIZE; i++)
        body[size + i] = (uint8_t)(crc >> 8 * i);
    size_t encoded = cobs_encode(body, size + WIRE_CRC_SIZE, frame);
    frame[encoded] = 0;
    return encoded + 1;
}

bool frame_open(const uint8_t *body, size_t size, struct wire_header *header, const uint8_t **payload,
                size_t *payload_size)
{
    if (size < WIRE_HEADER_SIZE + WIRE_CRC_SIZE || size > WIRE_MAX_BODY)
        return false;
    size -= WIRE_CRC_SIZE;
    uint32_t crc = 0;
    for (unsigned i = 0; i < WIRE_CRC_SIZE; i++)
        crc |= (uint32_t)body[size + i] << 8 * i;
    if (crc != crc32(0, body, size))
        return false;
    *payload = body + WIRE_HEADER_SIZE;
    *payload_size = size - WIRE_HEADER_SIZE;
    return wire_unpack_header(header, body, WIRE_HEADER_SIZE);
}
