#include "app/line.h"

#define LINE_BITS_PER_BYTE 10

void line_init(struct line *line)
{
    cobs_decoder_init(&line->decoder, line->rx, sizeof line->rx);
}

void line_begin_session(struct line *line, uint16_t id)
{
    line->done_ids = 0;
    line->newest_id = id;
}

uint32_t line_budget_bytes_per_s(uint32_t baud)
{
    uint32_t bytes_per_s = baud / LINE_BITS_PER_BYTE;
    return bytes_per_s - bytes_per_s / 20;
}
