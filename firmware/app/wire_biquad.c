#include "app/wire_biquad.h"

_Static_assert(sizeof(((struct wire_set_axis_request *)0)->filters) == LOOP_SECTIONS * sizeof(struct wire_biquad) &&
                   sizeof(((struct wire_set_gains_request *)0)->filters) == LOOP_SECTIONS * sizeof(struct wire_biquad),
               "schema and core");

struct biquad_config biquad_of_wire(const struct wire_biquad *section)
{
    const int32_t c_q26[] = {section->b0_q26, section->b1_q26, section->b2_q26, section->a1_q26, section->a2_q26};
    return biquad_of(c_q26);
}

bool loop_filter_of(const struct wire_biquad sections[LOOP_SECTIONS], struct loop_filter_config *filter)
{
    struct biquad_config config[LOOP_SECTIONS];
    for (unsigned i = 0; i < LOOP_SECTIONS; i++)
        config[i] = biquad_of_wire(&sections[i]);
    return loop_filter_make(filter, config);
}
