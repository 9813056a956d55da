/* Whether a model can be used, and the tables, inverses and decoupling it makes. */
#ifndef PHASELEAD_APP_MODEL_CHECK_H
#define PHASELEAD_APP_MODEL_CHECK_H

#include "app/model_slot.h"

#define MODEL_MAGIC 0x314C4850u
#define MODEL_FIELD_MAGIC 1000 /* the field number of the magic; those of an axis count from 1: 100 axis + number */

/* 0, or the number of the first field that is not usable. Fills the slot's tables, compensation, decoupling and
 * masks. */
uint16_t model_expand(struct model_slot *slot, struct wire_axis_model *room);

#endif
