/* The part of an axis' model that mode inverse undoes: from wire to core, checked. */
#ifndef PHASELEAD_APP_MODEL_INVERSE_H
#define PHASELEAD_APP_MODEL_INVERSE_H

#include "app/model_fields.h"
#include "app/wire.h"
#include "core/compensation.h"

/* FIELD_NONE, or the first field that is not usable. */
enum model_field model_compensation(const struct wire_axis_model *model, unsigned axis,
                                    struct compensation *compensation);

#endif
