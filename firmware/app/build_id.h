/* What the firmware was built from: a hash over its source that the build gives as PHASELEAD_BUILD_ID, in hex. */
#ifndef PHASELEAD_APP_BUILD_ID_H
#define PHASELEAD_APP_BUILD_ID_H

#include <stdint.h>

#define BUILD_ID_SIZE 20

void build_id(uint8_t id[BUILD_ID_SIZE]);

#endif
