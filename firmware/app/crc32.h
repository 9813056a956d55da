/* CRC-32/ISO-HDLC: polynomial 0x04C11DB7 reflected, check value 0xCBF43926 over "123456789". */
#ifndef PHASELEAD_APP_CRC32_H
#define PHASELEAD_APP_CRC32_H

#include <stddef.h>
#include <stdint.h>

/* CRC of `size` bytes. `crc` is 0, or the CRC of what came before them: crc32(crc32(0, a), b) is that of a then b. */
uint32_t crc32(uint32_t crc, const uint8_t *bytes, size_t size);

#endif
