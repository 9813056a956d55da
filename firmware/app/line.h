/* The line's buffers: what has come, what waits to go, and the last replies. */
#ifndef PHASELEAD_APP_LINE_H
#define PHASELEAD_APP_LINE_H

#include "app/frame.h"

#define REPLIES_KEPT 8
#define REPLY_KEPT_SIZE 128 /* bytes of header and payload; longer replies are reads, which may be done twice */
#define IDS_KNOWN 64        /* so far back a request is recognised as one that was carried out */

struct reply_kept { /* what a repeated request is answered with */
    uint64_t session;
    uint32_t request_crc;
    uint16_t id;
    uint16_t size; /* of header and payload; 0: none */
    uint8_t body[REPLY_KEPT_SIZE];
};

struct line {
    struct cobs_decoder decoder;
    uint32_t rx_errors;
    uint32_t reply_size; /* payload of the reply waiting in reply_body; 0: none */
    uint32_t frame_size, frame_sent;
    struct wire_header reply_header;
    struct reply_kept kept[REPLIES_KEPT];
    uint32_t kept_next;
    uint64_t done_ids; /* bit n: request newest_id - n of the session was carried out and its reply was kept */
    uint16_t newest_id;
    uint8_t rx[WIRE_MAX_BODY];
    uint8_t reply_body[WIRE_MAX_BODY];
    uint8_t event_body[WIRE_HEADER_SIZE + WIRE_EVENT_SIZE + WIRE_CRC_SIZE];
    uint8_t frame[FRAME_MAX];
};

void line_init(struct line *line);

/* No request of the session that this one begins has been carried out yet. */
void line_begin_session(struct line *line, uint16_t id);

/* What a stream may take of a line of this speed: 5 % is kept for replies and events. */
uint32_t line_budget_bytes_per_s(uint32_t baud);

#endif
