/* The stage behind the converters, and the host process that says how long to run.
 *
 * The host sends u32 size, u8 what, payload; each is answered with u32 size, payload. Time stands still meanwhile: it
 * passes in ASK_RUN alone, so a run is the same every time.
 */
#include "board.h"

#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BROKEN_SIZE UINT32_MAX
#define HOST_GONE 0

enum ask {
    ASK_STAGE = 1, /* u32 size of the parameters, u32 where in them the linked stage is pointed to, both stages */
    ASK_RUN,       /* u64 ticks, u64 bytes -> u64 ticks run, u64 changes of flash, bytes from the line */
    ASK_WRITE,     /* bytes to the line */
    ASK_BAUD,      /* u32 */
    ASK_INJECT,    /* u32 what, u32 value */
    ASK_FLASH,     /* -> sectors 1 to 7 */
    ASK_TRACE,     /* u64 capacity */
    ASK_TAKE_TRACE,
    ASK_CODES, /* -> u16 adc[3], u16 dac[3], u16 pulses[3] of every tick since the last time */
    ASK_COUNTS,
    ASK_PEEK, /* u32 address, u32 size */
    ASK_POKE, /* u32 address, bytes; flash too */
    ASK_TIME, /* -> u64 ns, u64 ticks of TIM2 */
};

struct plant;
static struct {
    struct plant *(*open)(const void *parameters);
    void (*sample)(struct plant *, uint16_t codes[AXES]);
    void (*drive)(struct plant *, const uint16_t codes[AXES]);
    int (*trace)(struct plant *, size_t capacity);
    size_t (*take_trace)(struct plant *, double *positions, size_t capacity, uint64_t *first);
} stage;

static int from_host, to_host;
static struct plant *plant;
static bool awake; /* the first tick has come: until then the stage rests */
static uint64_t ticks, ticks_left, wanted, ran;
static bool running;
static size_t trace_capacity;
static uint16_t (*codes_log)[3][AXES];
static size_t logged, log_capacity;

static void read_all(void *to, size_t size)
{
    for (size_t done = 0; done < size;) {
        ssize_t got = read(from_host, (char *)to + done, size - done);
        if (got <= 0)
            _Exit(HOST_GONE);
        done += (size_t)got;
    }
}

static void write_all(const void *from, size_t size)
{
    for (size_t done = 0; done < size;) {
        ssize_t put = write(to_host, (const char *)from + done, size - done);
        if (put <= 0)
            _Exit(HOST_GONE);
        done += (size_t)put;
    }
}

static void answer(const void *bytes, size_t size)
{
    uint32_t head = (uint32_t)size;
    write_all(&head, sizeof head);
    write_all(bytes, size);
}

void world_say_broken(const char *text)
{
    uint32_t head[2] = {BROKEN_SIZE, (uint32_t)strlen(text)};
    write_all(head, sizeof head);
    write_all(text, head[1]);
}

static void *room(size_t size)
{
    void *place = malloc(size > 0 ? size : 1);
    if (!place)
        board_broken("out of memory");
    return place;
}

static void answer_run(void)
{
    size_t size = line_readable();
    uint8_t *bytes = room(16 + size);
    uint64_t changes = flash_changes();
    memcpy(bytes, &ran, 8);
    memcpy(bytes + 8, &changes, 8);
    line_take(bytes + 16, size);
    answer(bytes, 16 + size);
    free(bytes);
}

static void answer_trace(void)
{
    uint64_t first = 0;
    uint8_t *bytes = room(8 + trace_capacity * AXES * sizeof(double));
    double *positions = room(trace_capacity * AXES * sizeof(double));
    size_t count = stage.take_trace(plant, positions, trace_capacity, &first);
    memcpy(bytes, &first, 8);
    memcpy(bytes + 8, positions, count * AXES * sizeof(double));
    answer(bytes, 8 + count * AXES * sizeof(double));
    free(positions);
    free(bytes);
}

static void answer_peek(uint32_t address, uint32_t size)
{
    uint8_t *bytes = room(size);
    cpu_physical_memory_rw(address, bytes, size, false);
    answer(bytes, size);
    free(bytes);
}

static uint32_t u32_at(const uint8_t *bytes, size_t at)
{
    uint32_t value;
    memcpy(&value, bytes + at, sizeof value);
    return value;
}

static void open_stage(const uint8_t *bytes, size_t size)
{
    uint32_t own = u32_at(bytes, 0), pointer = u32_at(bytes, 4);
    uint8_t *parameters = room(size - 8); /* kept: a linked stage may go on looking at them */
    memcpy(parameters, bytes + 8, size - 8);
    const void *linked = size - 8 > own ? parameters + own : NULL;
    memcpy(parameters + pointer, (const void *)&linked, sizeof linked);
    plant = stage.open(parameters);
    uint8_t opened = plant != NULL;
    answer(&opened, 1);
}

static void start_run(const uint8_t *bytes)
{
    memcpy(&ticks_left, bytes, 8);
    memcpy(&wanted, bytes + 8, 8);
    ran = 0;
    running = true;
}

static void obey(enum ask what, const uint8_t *bytes, size_t size)
{
    uint64_t figures[COUNT_FIGURES];
    switch (what) {
    case ASK_STAGE:
        open_stage(bytes, size);
        return;
    case ASK_RUN:
        start_run(bytes);
        return;
    case ASK_FLASH:
        answer(flash_cells() + FLASH_KEPT_FROM, FLASH_CELLS - FLASH_KEPT_FROM);
        return;
    case ASK_TAKE_TRACE:
        answer_trace();
        return;
    case ASK_CODES:
        answer(codes_log, logged * sizeof *codes_log);
        logged = 0;
        return;
    case ASK_COUNTS:
        answer(figures, 8 * count_report(figures, COUNT_FIGURES));
        return;
    case ASK_PEEK:
        answer_peek(u32_at(bytes, 0), u32_at(bytes, 4));
        return;
    case ASK_TIME:
        figures[0] = (uint64_t)now_ns();
        figures[1] = ticks;
        answer(figures, 16);
        return;
    case ASK_WRITE:
        line_write(bytes, size);
        break;
    case ASK_BAUD:
        line_set_baud(u32_at(bytes, 0));
        break;
    case ASK_INJECT:
        inject(u32_at(bytes, 0), u32_at(bytes, 4));
        break;
    case ASK_TRACE:
        memcpy(&trace_capacity, bytes, 8);
        stage.trace(plant, trace_capacity);
        break;
    case ASK_POKE:
        flash_poke(u32_at(bytes, 0), bytes + 4, size - 4);
        break;
    }
    answer(NULL, 0);
}

static void serve_until_run(void)
{
    while (!running) {
        uint32_t size;
        uint8_t what;
        read_all(&size, sizeof size);
        read_all(&what, 1);
        uint8_t *bytes = room(size);
        read_all(bytes, size);
        obey((enum ask)what, bytes, size);
        free(bytes);
    }
}

static void log_codes(unsigned which, const uint16_t codes[AXES])
{
    if (logged == log_capacity) {
        log_capacity = 2 * log_capacity + 4096;
        void *moved = realloc(codes_log, log_capacity * sizeof *codes_log);
        if (!moved)
            board_broken("out of memory");
        codes_log = moved;
    }
    memcpy(codes_log[logged][which], codes, AXES * sizeof *codes);
}

static void end_tick(void)
{
    uint16_t codes[AXES];
    dac_output(codes);
    if (awake) {
        log_codes(1, codes);
        const uint16_t pulses = (uint16_t)gpio_take_pulses();
        for (unsigned pin = 0; pin < AXES; pin++)
            codes_log[logged][2][pin] = pulses >> pin & 1u;
        logged++;
        stage.drive(plant, codes);
    }
    line_pass(TICK_NS);
    ran++;
    ticks_left -= ticks_left > 0;
    if (running && (ticks_left == 0 || (wanted > 0 && line_readable() >= wanted))) {
        running = false;
        answer_run();
    }
}

void world_tick(void)
{
    uint16_t codes[AXES];
    end_tick();
    serve_until_run();
    awake = awake || timer_runs();
    if (!awake)
        return;
    stage.sample(plant, codes);
    log_codes(0, codes);
    if (timer_runs()) {
        adc_convert(codes);
        ticks++;
    }
}

void world_start(void)
{
    serve_until_run();
}

static void *symbol(void *library, const char *name)
{
    void *found = dlsym(library, name);
    if (!found)
        board_broken("the stage library has no %s", name);
    return found;
}

bool world_open(int in, int out, const char *library)
{
    void *handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    from_host = in;
    to_host = out;
    if (!handle)
        return false;
    *(void **)&stage.open = symbol(handle, "plant_open");
    *(void **)&stage.sample = symbol(handle, "plant_sample");
    *(void **)&stage.drive = symbol(handle, "plant_drive");
    *(void **)&stage.trace = symbol(handle, "plant_trace");
    *(void **)&stage.take_trace = symbol(handle, "plant_take_trace");
    return true;
}
