/* Second-order sections, from wire to core. */
#ifndef PHASELEAD_APP_WIRE_BIQUAD_H
#define PHASELEAD_APP_WIRE_BIQUAD_H

#include "app/wire.h"
#include "core/loop_filter.h"

struct biquad_config biquad_of_wire(const struct wire_biquad *section);

/* False when one of the sections is not usable. */
bool loop_filter_of(const struct wire_biquad sections[LOOP_SECTIONS], struct loop_filter_config *filter);

#endif
