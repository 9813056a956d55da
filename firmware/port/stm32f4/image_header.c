#include "port/stm32f4/image_header.h"

/* Linker script. */
extern const uint8_t image_begin[], image_length[];

/* Its CRC and build id are filled in after linking: images.py. */
static const volatile struct image_header header __attribute__((section(".image_header"), used)) = {
    .magic = IMAGE_MAGIC,
    .length = (uint32_t)image_length,
    .address = (uint32_t)image_begin,
    .version = PHASELEAD_VERSION,
    .target = BOARD_NAME,
};

const struct image_header *image_own_header(void)
{
    return (const struct image_header *)&header;
}
