/* The device in the host process: what the Python package calls (ctypes), and what replay and tests drive.
 *
 * Every function takes an opaque handle. Nothing here blocks, sleeps or keeps global state.
 */
#ifndef PHASELEAD_PORT_HOST_H
#define PHASELEAD_PORT_HOST_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define HOST_API __attribute__((visibility("default")))
#else
#define HOST_API
#endif

/* What the other end of the line holds for a reader that is late; then the line stands still and the device's own
 * recorder begins to drop. */
#define HOST_LINE_SIZE (1u << 20)

struct host_device;

/* A device fresh from power-on. flash: its models and journal (HOST_FLASH_SIZE bytes, flash.h), what host_cells() gave,
 * or NULL for erased. NULL when the image has another size or memory is short. */
HOST_API struct host_device *host_open(uint32_t baud, const uint8_t *flash, size_t flash_size);
HOST_API void host_close(struct host_device *device);

/* Bytes to and from the serial line. Writing never blocks; reading returns what has left the device, up to `size`. */
HOST_API size_t host_write(struct host_device *device, const uint8_t *bytes, size_t size);
HOST_API size_t host_read(struct host_device *device, uint8_t *bytes, size_t size);
HOST_API size_t host_readable(const struct host_device *device);
HOST_API uint64_t host_tick(const struct host_device *device);

/* Runs up to `ticks` ticks against a plant, stopping early once `want_bytes` are readable (0: never). Returns ticks
 * run. */
struct plant;
HOST_API uint64_t host_run(struct host_device *device, struct plant *plant, uint64_t ticks, size_t want_bytes);

/* Runs `ticks` ticks against recorded converter codes: adc_codes[ticks][3] in, dac_codes[ticks][3] out. The line is
 * infinitely fast meanwhile. */
HOST_API void host_run_codes(struct host_device *device, const uint16_t *adc_codes, uint16_t *dac_codes,
                             uint64_t ticks);

enum host_restored { HOST_RESTORED, HOST_NOT_A_STATE, HOST_WITHOUT_WAVE, HOST_WITHOUT_MODEL };

/* Sets tick, control state (as read by SNAPSHOT_READ region state) and session, for replay; or says why it cannot. From
 * then on the line is infinitely fast and what the device says goes nowhere, so that a command takes effect where it
 * is written. */
HOST_API int host_restore(struct host_device *device, uint64_t session, const uint8_t *state, size_t size);

/* Mask of the axes whose output follows a path, and so may depend on their ADC codes. */
HOST_API uint32_t host_driven_axes(const struct host_device *device);

/* Bytes of the control state. */
HOST_API size_t host_state_size(void);

/* The flash image, for ?state=FILE. `*writes` counts its erases and programs, so that a caller sees when to keep it. */
HOST_API const uint8_t *host_flash(const struct host_device *device, size_t *size, uint64_t *writes);

/* All that is known of its flash: models, images, boot record, and the bits in doubt. */
HOST_API const uint8_t *host_cells(const struct host_device *device, size_t *size);

/* Fault injection for tests: see enum fault in wire.h. adc_rail forces the converter of the axis to its rail for
 * `RAIL_TICKS` ticks and more; core_lost restarts the device as its watchdog would; the others are raised as a port
 * that detects them would raise them. */
HOST_API void host_inject(struct host_device *device, uint32_t fault, uint32_t axis);

/* The reset pin: memory that a reset leaves as it is keeps what it holds. */
HOST_API void host_reset(struct host_device *device);

/* That memory. */
HOST_API uint8_t *host_kept_memory(struct host_device *device, size_t *size);

struct host_obeyed {
    uint64_t session;
    uint32_t id, type;
};

/* An edge comes at the trigger input before this tick; false when it has passed, or when HOST_EDGES are still to
 * come. */
#define HOST_EDGES 64
HOST_API int host_trigger_at(struct host_device *device, uint64_t tick);

/* The commands that were carried out, not those that were refused before or answered from memory, the oldest of the
 * last HOST_OBEYED first: copies up to `capacity`, forgets them all and returns how many there were since the last
 * call. */
#define HOST_OBEYED 4096
HOST_API uint64_t host_take_obeyed(struct host_device *device, struct host_obeyed *commands, size_t capacity);

/* Power goes when `bytes` more bytes of flash have been erased or programmed; the bits under way then read
 * either way. */
HOST_API void host_cut_power_after(struct host_device *device, uint64_t bytes);

/* The tables the documentation and the tests compare with the code. Names are NULL beyond the last one. */
HOST_API const char *host_state_name(uint32_t state);
HOST_API const char *host_event_name(uint32_t event);
HOST_API const char *host_action_name(uint32_t action);
HOST_API const char *host_fault_reaction(uint32_t fault);
/* state | action << 8 */
HOST_API uint32_t host_transition(uint32_t state, uint32_t event);
/* `n` values (q40) in place through `count` sections of five coefficients each (b0 b1 b2 a1 a2, q26), from zero. */
HOST_API void host_run_sections(const int32_t *coefficients_q26, size_t count, int64_t *values_q40, size_t n);
/* RAM of the device, without this port. */
HOST_API size_t host_device_size(void);

#endif
