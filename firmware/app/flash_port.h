/* Flash as a port gives it: slots that are erased whole and programmed piece by piece. */
#ifndef PHASELEAD_APP_FLASH_PORT_H
#define PHASELEAD_APP_FLASH_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FLASH_SLOTS 2 /* of models, and of the journal */

/* Each of `erase` and `program` returns false when the flash did not do it. A slot reads 0xFF when erased. */
struct flash_port {
    bool (*erase)(void *context, unsigned slot);
    bool (*program)(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size);
    void (*read)(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size);
    void *context;
};

/* Programs, and sees that the flash holds it. */
bool flash_program_verified(const struct flash_port *flash, unsigned slot, uint32_t offset, const uint8_t *bytes,
                            size_t size);

#endif
