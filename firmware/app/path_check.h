/* Whether an axis can follow a path, whichever command asks for it. Not for the tick. */
#ifndef PHASELEAD_APP_PATH_CHECK_H
#define PHASELEAD_APP_PATH_CHECK_H

#include "app/device.h"
#include "core/motion_bounds.h"

/* Fills in the point of the tables and the steps of the joins. Not ok: the axis cannot use it. */
enum wire_status path_check(const struct device *device, unsigned axis, struct segment *segment);

/* Whether the model that the device holds is the one, of this CRC, that a waveform was learned with; 0: any is. */
bool path_check_learned_with(const struct device *device, uint32_t model_crc);

/* Whether this path may be played by what the axis has as its waveform: what was learned is right for one model and one
 * path alone. */
bool path_check_learned_for(const struct device *device, unsigned axis, const struct path_config *path);

/* The values of a path that comes after one with these. */
struct path_span path_check_span(const struct path_config *path, const struct path_span *here);

#endif
