/* Two slots of flash, as a port gives them. */
#ifndef PHASELEAD_APP_FLASH_PORT_H
#define PHASELEAD_APP_FLASH_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FLASH_SLOTS 2

/* Erase and program return false when the flash did not do it. An erased slot reads 0xFF. */
struct flash_port {
    bool (*erase)(void *context, unsigned slot);
    bool (*program)(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size);
    void (*read)(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size);
    void *context;
};

/* Programs, reads back and compares. */
bool flash_program_verified(const struct flash_port *flash, unsigned slot, uint32_t offset, const uint8_t *bytes,
                            size_t size);

#endif
