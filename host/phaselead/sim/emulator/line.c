/* USART1, USART2 and the DMA controllers that move their bytes, a tick at a time: the line carries what its speed
 * allows.
 */
#include "board.h"

#include <stdlib.h>
#include <string.h>

#define STREAMS 8
#define CR_EN 1u
#define CR_TCIE (1u << 4)
#define CR_DIR_OUT (1u << 6)
#define CR_CIRC (1u << 8)
#define CR_MINC (1u << 10)
#define TCIF (1u << 5)
#define USART_ON 0x200Cu /* UE, TE, RE */
#define USART_DMA 0xC0u  /* DMAT, DMAR */
#define BITS_PER_BYTE 10
#define MOST_OFF_PERCENT 3
#define NOISE 0x5A

struct stream {
    uint32_t cr, ndtr, par, m0ar, fcr, at;
};
struct dma {
    struct stream streams[STREAMS];
    uint32_t isr[2];
    int number;
};
struct usart {
    uint32_t regs[7];
    int number;
    uint64_t base;
};
struct bytes {
    uint8_t *data;
    size_t first, size, capacity;
};

static MemoryRegion dma_regions[2], usart_regions[2];
static struct dma dmas[2] = {{.number = 1}, {.number = 2}};
static struct usart usarts[2] = {{.number = 1, .base = 0x40011000}, {.number = 2, .base = 0x40004400}};
static struct bytes to_board, from_board;
static uint64_t in_credit, out_credit; /* bits x ns */
static uint32_t host_baud = 2000000, noisy;

static void put(struct bytes *queue, const uint8_t *data, size_t size)
{
    if (queue->first + queue->size + size > queue->capacity) {
        memmove(queue->data, queue->data + queue->first, queue->size);
        queue->first = 0;
        queue->capacity = 2 * (queue->size + size) + 4096;
        uint8_t *moved = realloc(queue->data, queue->capacity);
        if (!moved)
            board_broken("out of memory");
        queue->data = moved;
    }
    memcpy(queue->data + queue->first + queue->size, data, size);
    queue->size += size;
}

static size_t take(struct bytes *queue, uint8_t *data, size_t size)
{
    size = size < queue->size ? size : queue->size;
    memcpy(data, queue->data + queue->first, size);
    queue->first = size == queue->size ? 0 : queue->first + size;
    queue->size -= size;
    return size;
}

void line_write(const uint8_t *bytes, size_t size)
{
    put(&to_board, bytes, size);
}

size_t line_readable(void)
{
    return from_board.size;
}

size_t line_take(uint8_t *bytes, size_t size)
{
    return take(&from_board, bytes, size);
}

void line_set_baud(uint32_t baud)
{
    host_baud = baud;
}

void line_garble(uint32_t bytes)
{
    noisy = bytes;
}

/* ---------------------------------------------------------------- USART */
static bool usart_clocked(const struct usart *usart)
{
    return usart->number == 1 ? rcc_on(RCC_APB2ENR, 4) : rcc_on(RCC_APB1ENR, 17);
}

static bool usart_pins(const struct usart *usart)
{
    unsigned tx = usart->number == 1 ? 9 : 2;
    return gpio_is_function(GPIO_A, tx, 7) && gpio_is_function(GPIO_A, tx + 1, 7);
}

static bool usart_on(const struct usart *usart)
{
    return usart_clocked(usart) && usart_pins(usart) && (usart->regs[3] & USART_ON) == USART_ON &&
           (usart->regs[5] & USART_DMA) == USART_DMA && usart->regs[2] >= 16;
}

static uint64_t usart_read(void *opaque, uint64_t offset, unsigned size)
{
    struct usart *usart = opaque;
    (void)size;
    if (!usart_clocked(usart) || offset / 4 >= 7)
        return 0;
    return offset == 0 ? 0xC0u : usart->regs[offset / 4];
}

static void usart_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    struct usart *usart = opaque;
    (void)size;
    if (usart_clocked(usart) && offset / 4 < 7)
        usart->regs[offset / 4] = (uint32_t)value;
}

static uint32_t usart_baud(const struct usart *usart)
{
    return (uint32_t)(rcc_apb_Hz(usart->number == 1 ? 2 : 1) / usart->regs[2]);
}

/* ---------------------------------------------------------------- DMA */
static unsigned flag_shift(unsigned stream)
{
    static const unsigned SHIFTS[4] = {0, 6, 16, 22};
    return SHIFTS[stream % 4];
}

static void stream_irq(const struct dma *dma, unsigned i)
{
    static const int IRQS[2][STREAMS] = {{11, 12, 13, 14, 15, 16, 17, 47}, {56, 57, 58, 59, 60, 68, 69, 70}};
    bool done = dma->isr[i / 4] >> flag_shift(i) & TCIF;
    board_irq(IRQS[dma->number - 1][i], done && dma->streams[i].cr & CR_TCIE);
}

static bool dma_clocked(const struct dma *dma)
{
    return rcc_on(RCC_AHB1ENR, dma->number == 1 ? 21 : 22);
}

static uint64_t dma_read(void *opaque, uint64_t offset, unsigned size)
{
    struct dma *dma = opaque;
    (void)size;
    if (!dma_clocked(dma) || offset >= 0x10 + 0x18 * STREAMS)
        return 0;
    if (offset < 8)
        return dma->isr[offset / 4];
    if (offset < 0x10)
        return 0;
    const struct stream *stream = &dma->streams[(offset - 0x10) / 0x18];
    const uint32_t values[6] = {stream->cr, stream->ndtr - stream->at, stream->par, stream->m0ar, 0, stream->fcr};
    return values[(offset - 0x10) % 0x18 / 4];
}

static void switch_stream(struct dma *dma, unsigned i, uint32_t cr)
{
    struct stream *stream = &dma->streams[i];
    if ((cr & CR_EN) && !(stream->cr & CR_EN)) {
        if (dma->isr[i / 4] >> flag_shift(i) & TCIF)
            board_broken("DMA%d stream %u is started with its flags still set", dma->number, i);
        stream->at = 0;
    }
    stream->cr = cr;
    stream_irq(dma, i);
}

static void dma_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    struct dma *dma = opaque;
    (void)size;
    if (!dma_clocked(dma) || offset < 8 || offset >= 0x10 + 0x18 * STREAMS)
        return;
    if (offset < 0x10) {
        dma->isr[offset / 4 - 2] &= ~(uint32_t)value;
        for (unsigned i = 0; i < STREAMS; i++)
            stream_irq(dma, i);
        return;
    }
    unsigned i = (unsigned)(offset - 0x10) / 0x18;
    struct stream *stream = &dma->streams[i];
    uint32_t *const places[6] = {NULL, &stream->ndtr, &stream->par, &stream->m0ar, NULL, &stream->fcr};
    unsigned place = (unsigned)(offset - 0x10) % 0x18 / 4;
    if (place == 0)
        switch_stream(dma, i, (uint32_t)value);
    else if (places[place] && !(stream->cr & CR_EN)) {
        *places[place] = (uint32_t)value;
        stream->at = 0;
    }
}

static void stream_done(struct dma *dma, unsigned i)
{
    dma->streams[i].at = 0;
    dma->isr[i / 4] |= TCIF << flag_shift(i);
    if (!(dma->streams[i].cr & CR_CIRC)) {
        dma->streams[i].ndtr = 0;
        dma->streams[i].cr &= ~CR_EN;
    }
    stream_irq(dma, i);
}

/* Which stream serves this USART in this direction (RM0090 tables 42 and 43), when it is set up for it. */
static struct dma *serving(const struct usart *usart, bool out, unsigned *stream)
{
    struct dma *dma = &dmas[usart->number == 1];
    const struct stream *found;
    *stream = usart->number == 1 ? (out ? 7 : 5) : (out ? 6 : 5);
    found = &dma->streams[*stream];
    bool fits = (found->cr & CR_EN) && (found->cr >> 25 & 7u) == 4 && (found->cr & CR_MINC) &&
                !!(found->cr & CR_DIR_OUT) == out && found->par == usart->base + 4;
    return fits && dma_clocked(dma) ? dma : NULL;
}

static void receive_byte(const struct usart *usart, uint8_t byte)
{
    unsigned i;
    struct dma *dma = serving(usart, false, &i);
    uint32_t baud = usart_baud(usart), off = baud > host_baud ? baud - host_baud : host_baud - baud;
    if (!dma)
        return;
    if (off > host_baud / 100 * MOST_OFF_PERCENT || noisy > 0)
        byte ^= NOISE;
    noisy -= noisy > 0;
    struct stream *stream = &dma->streams[i];
    cpu_physical_memory_rw(stream->m0ar + stream->at++, &byte, 1, true);
    if (stream->at == stream->ndtr)
        stream_done(dma, i);
}

static uint64_t carried(uint64_t *credit, uint32_t baud, int64_t ns)
{
    *credit += (uint64_t)ns * baud;
    return *credit / ((uint64_t)BITS_PER_BYTE * 1000000000u);
}

static void pass_in(const struct usart *usart, int64_t ns)
{
    uint64_t bytes = carried(&in_credit, host_baud, ns);
    uint8_t byte;
    while (bytes > 0 && take(&to_board, &byte, 1) == 1) {
        in_credit -= (uint64_t)BITS_PER_BYTE * 1000000000u;
        bytes--;
        if (usart_on(usart))
            receive_byte(usart, byte);
    }
    if (to_board.size == 0)
        in_credit = 0;
}

static void pass_out(const struct usart *usart, int64_t ns)
{
    unsigned i;
    struct dma *dma = usart_on(usart) ? serving(usart, true, &i) : NULL;
    if (!dma) {
        out_credit = 0;
        return;
    }
    struct stream *stream = &dma->streams[i];
    uint64_t bytes = carried(&out_credit, usart_baud(usart), ns), left = stream->ndtr - stream->at;
    bytes = bytes < left ? bytes : left;
    uint8_t data[4096];
    bytes = bytes < sizeof data ? bytes : sizeof data;
    cpu_physical_memory_rw(stream->m0ar + stream->at, data, bytes, false);
    put(&from_board, data, bytes);
    stream->at += (uint32_t)bytes;
    out_credit -= bytes * BITS_PER_BYTE * 1000000000u;
    if (stream->at == stream->ndtr)
        stream_done(dma, i);
}

void line_pass(int64_t ns)
{
    const struct usart *usart = &usarts[board.usart - 1]; /* the one that is wired */
    pass_in(usart, ns);
    pass_out(usart, ns);
}

void line_reset(void)
{
    for (int n = 0; n < 2; n++) {
        memset(dmas[n].streams, 0, sizeof dmas[n].streams);
        memset(dmas[n].isr, 0, sizeof dmas[n].isr);
        memset(usarts[n].regs, 0, sizeof usarts[n].regs);
        for (unsigned i = 0; i < STREAMS; i++)
            stream_irq(&dmas[n], i);
    }
}

void line_map(void)
{
    static const MemoryRegionOps dma_ops = {
        .read = dma_read, .write = dma_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    static const MemoryRegionOps usart_ops = {
        .read = usart_read, .write = usart_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    for (unsigned n = 0; n < 2; n++) {
        memory_region_init_io(&dma_regions[n], NULL, &dma_ops, &dmas[n], "dma", 0x400);
        memory_region_add_subregion_overlap(get_system_memory(), 0x40026000u + 0x400u * n, &dma_regions[n], 10);
        memory_region_init_io(&usart_regions[n], NULL, &usart_ops, &usarts[n], "usart", 0x400);
        memory_region_add_subregion_overlap(get_system_memory(), usarts[n].base, &usart_regions[n], 10);
    }
}
