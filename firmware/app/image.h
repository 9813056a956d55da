/* A firmware image in flash: a header, then vectors and code, executed where it lies. */
#ifndef PHASELEAD_APP_IMAGE_H
#define PHASELEAD_APP_IMAGE_H

#include "app/flash_port.h"

#define IMAGE_MAGIC 0x31494C50u /* "PLI1" */
#define IMAGE_HEADER_SIZE 64
#define IMAGE_VECTORS 0x200u /* from the image's beginning; a vector table of 113 entries needs 512-byte steps */
#define IMAGE_SLOTS 2
#define IMAGE_TARGET_SIZE 24
#define IMAGE_BUILD_ID_SIZE 20

/* The slots of the flash port that images are in, and what says which of them is to run. */
enum image_flash_slot { IMAGE_SLOT_A, IMAGE_SLOT_B, BOOT_RECORD_SLOT };

/* As it lies in flash, little-endian. */
struct image_header {
    uint32_t magic;
    uint32_t crc;     /* CRC-32/ISO-HDLC of all that follows it, up to `length` */
    uint32_t length;  /* of the whole image, header included; a multiple of 4 */
    uint32_t address; /* that it is linked for */
    uint32_t version; /* major << 16 | minor << 8 | patch */
    char target[IMAGE_TARGET_SIZE];
    uint8_t build_id[IMAGE_BUILD_ID_SIZE];
};
_Static_assert(sizeof(struct image_header) == IMAGE_HEADER_SIZE, "the header is padded");
#define IMAGE_CRC_FROM 8u

/* CRC-32/ISO-HDLC of a slot's bytes `from` to `to`, continuing `crc`. */
typedef uint32_t image_crc_function(const struct flash_port *flash, unsigned slot, uint32_t crc, uint32_t from,
                                    uint32_t to);
image_crc_function image_crc;

/* The header by itself: could such an image be in a slot of this size at this address? */
bool image_header_is_sound(const struct image_header *header, uint32_t address, uint32_t slot_size);

/* Reads the header of a slot; true when a whole image for this address is in it. */
bool image_is_whole(const struct flash_port *flash, unsigned slot, uint32_t address, uint32_t slot_size,
                    image_crc_function *crc, struct image_header *header);

#endif
