#include "app/image.h"

#include "app/crc32.h"

uint32_t image_crc(const struct flash_port *flash, unsigned slot, uint32_t crc, uint32_t from, uint32_t to)
{
    uint8_t bytes[64];
    while (from < to) {
        uint32_t part = to - from < sizeof bytes ? to - from : sizeof bytes;
        flash->read(flash->context, slot, from, bytes, part);
        crc = crc32(crc, bytes, part);
        from += part;
    }
    return crc;
}

bool image_header_is_sound(const struct image_header *header, uint32_t address, uint32_t slot_size)
{
    return header->magic == IMAGE_MAGIC && header->address == address && header->length > IMAGE_VECTORS &&
           header->length <= slot_size && header->length % 4 == 0;
}

bool image_is_whole(const struct flash_port *flash, unsigned slot, uint32_t address, uint32_t slot_size,
                    image_crc_function *crc, struct image_header *header)
{
    flash->read(flash->context, slot, 0, (uint8_t *)header, sizeof *header);
    return image_header_is_sound(header, address, slot_size) &&
           crc(flash, slot, 0, IMAGE_CRC_FROM, header->length) == header->crc;
}
