/* The header of the image that runs. */
#ifndef PHASELEAD_STM32F4_IMAGE_HEADER_H
#define PHASELEAD_STM32F4_IMAGE_HEADER_H

#include "app/image.h"

const struct image_header *image_own_header(void);

#endif
