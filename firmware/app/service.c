#include "app/service.h"

#include <string.h>

#include "app/commands.h"
#include "app/device_tick.h"

static struct reply_kept *find_kept(struct line *line, const struct wire_header *header)
{
    for (unsigned i = 1; i <= REPLIES_KEPT; i++) { /* from the last one back */
        struct reply_kept *kept = &line->kept[(line->kept_next - i) % REPLIES_KEPT];
        if (kept->size != 0 && kept->id == header->id && kept->session == header->session)
            return kept;
    }
    return NULL;
}

/* How far a request's number lies behind the newest one; at most zero for a new one. Numbers wrap around. */
static int32_t behind(const struct line *line, uint16_t id)
{
    uint16_t distance = (uint16_t)(line->newest_id - id);
    return distance < 0x8000 ? distance : (int32_t)distance - 0x10000;
}

/* A copy of a frame that lay on the line for so long that its reply is no longer kept. */
static bool is_stale(const struct line *line, uint16_t id)
{
    int32_t back = behind(line, id);
    return back >= IDS_KNOWN || (back >= 0 && (line->done_ids >> back & 1u) != 0);
}

static void note_done(struct line *line, uint16_t id)
{
    int32_t back = behind(line, id);
    if (back < 0) {
        line->done_ids = -back < IDS_KNOWN ? line->done_ids << -back : 0;
        line->newest_id = id;
        back = 0;
    }
    if (back < IDS_KNOWN)
        line->done_ids |= (uint64_t)1 << back;
}

static void keep(struct line *line, const struct wire_header *header, uint32_t request_crc)
{
    if (line->reply_size > REPLY_KEPT_SIZE)
        return;
    struct reply_kept *kept = &line->kept[line->kept_next++ % REPLIES_KEPT];
    kept->session = header->session;
    kept->request_crc = request_crc;
    kept->id = header->id;
    kept->size = (uint16_t)line->reply_size;
    memcpy(kept->body, line->reply_body + WIRE_HEADER_SIZE, line->reply_size);
    note_done(line, header->id);
}

/* Makes a request of another revision as long as this one knows it: what is missing is zero, and what is beyond may be
 * nothing else. False when it cannot be done. The payload lies in the line's buffer, which has room for any. */
static bool fit_request(struct line *line, struct request *request)
{
    const struct wire_message_size *size = wire_message_size(request->header->type);
    uint8_t *payload = line->rx + WIRE_HEADER_SIZE;
    if (request->size < size->least)
        return false;
    if (size->has_tail)
        return true;
    for (size_t i = size->fixed; i < request->size; i++)
        if (payload[i] != 0)
            return false;
    for (size_t i = request->size; i < size->fixed; i++)
        payload[i] = 0;
    request->size = size->fixed;
    return true;
}

/* What stands in the way of a command, ok when nothing does. */
static enum wire_status admit(struct device *device, const struct command *command, bool in_session,
                              struct request *request)
{
    uint8_t type = request->header->type;
    if (!in_session && type != WIRE_HELLO && type != WIRE_STOP)
        return WIRE_STATUS_NO_SESSION;
    if (!command->handler)
        return WIRE_STATUS_UNKNOWN_COMMAND;
    if (!fit_request(&device->line, request))
        return WIRE_STATUS_BAD_LENGTH;
    if (!(command->states >> device->control.state & 1u))
        return device->control.state == WIRE_STATE_FAULT ? WIRE_STATUS_FAULT_LATCHED : WIRE_STATUS_WRONG_STATE;
    return WIRE_STATUS_OK;
}

static enum wire_status perform(struct device *device, const struct command *command, const struct request *request,
                                struct answer *answer)
{
    if (device->port.obeyed)
        device->port.obeyed(device->port.context, request->header);
    if (command->locks_itself)
        return command->handler(device, request, answer);
    device_lock(device);
    answer->tick = device->control.tick;
    enum wire_status status = command->handler(device, request, answer);
    device_unlock(device);
    return status;
}

static void obey(struct device *device, struct request *request, bool in_session)
{
    struct line *line = &device->line;
    const struct command *command = command_find(request->header->type);
    struct answer answer = {.payload = line->reply_body + WIRE_HEADER_SIZE, .size = WIRE_REPLY_HEAD_SIZE};
    device_put_path_events(device); /* before the command can begin another path */
    if (command->handler)
        answer.size = wire_message_size(request->header->type | WIRE_REPLY_BIT)->fixed;
    memset(answer.payload, 0, answer.size);
    device_lock(device);
    answer.tick = device->control.tick;
    enum wire_status status = admit(device, command, in_session, request);
    if (in_session && status != WIRE_STATUS_UNKNOWN_COMMAND && status != WIRE_STATUS_BAD_LENGTH)
        device->control.heard_tick = device->control.tick;
    device_unlock(device);
    if (status == WIRE_STATUS_OK)
        status = perform(device, command, request, &answer);
    struct wire_reply_head head = {(uint8_t)status, answer.tick};
    wire_pack_reply_head(&head, answer.payload, WIRE_REPLY_HEAD_SIZE);
    line->reply_size = (uint32_t)answer.size;
}

/* A repeat is answered without being done again, but its host lives. */
static void note_heard(struct device *device)
{
    device_lock(device);
    device->control.heard_tick = device->control.tick;
    device_unlock(device);
}

static void take_frame(struct device *device, const uint8_t *body, size_t size)
{
    struct line *line = &device->line;
    struct wire_header header;
    struct request request = {.header = &header};
    if (!frame_open(body, size, &header, &request.payload, &request.size)) {
        line->rx_errors++;
        return;
    }
    uint32_t request_crc;
    memcpy(&request_crc, body + size - WIRE_CRC_SIZE, sizeof request_crc);
    line->reply_header = header;
    line->reply_header.type |= WIRE_REPLY_BIT;
    bool in_session = device->session != 0 && header.session == device->session;
    const struct reply_kept *kept = in_session ? find_kept(line, &header) : NULL;
    if (kept && kept->request_crc == request_crc) {
        note_heard(device);
        memcpy(line->reply_body + WIRE_HEADER_SIZE, kept->body, kept->size);
        line->reply_size = kept->size;
        return;
    }
    if (in_session && !kept && header.type != WIRE_STOP && is_stale(line, header.id)) {
        line->rx_errors++;
        return;
    }
    obey(device, &request, in_session);
    bool known = device->session != 0 && header.session == device->session; /* HELLO may have made it so */
    if (known && header.type != WIRE_STOP)                                  /* a stop is always done again */
        keep(line, &header, request_crc);
}

size_t service_receive(struct device *device, const uint8_t *bytes, size_t size)
{
    struct line *line = &device->line;
    size_t taken = 0;
    while (taken < size && line->reply_size == 0) {
        switch (cobs_decoder_push(&line->decoder, bytes[taken++])) {
        case COBS_FRAME:
            take_frame(device, line->rx, line->decoder.size);
            break;
        case COBS_ERROR:
            line->rx_errors++;
            break;
        case COBS_NOTHING:
            break;
        }
    }
    return taken;
}

static size_t seal_event(struct device *device)
{
    struct line *line = &device->line;
    struct wire_event event;
    struct wire_header header = {.type = WIRE_EVENT, .session = device->session};
    device_put_path_events(device);
    while (events_take(&device->events, &event, &header.id)) {
        if (device->session == 0)
            continue; /* nobody to tell */
        wire_pack_event(&event, line->event_body + WIRE_HEADER_SIZE, WIRE_EVENT_SIZE);
        return frame_seal(&header, line->event_body, WIRE_EVENT_SIZE, line->frame);
    }
    return 0;
}

static size_t seal_batch(struct device *device)
{
    size_t payload_size;
    struct wire_header header = {.type = WIRE_SAMPLES, .session = device->session};
    struct recorder_batch *batch = recorder_next(&device->recorder, &payload_size);
    if (!batch)
        return 0;
    size_t size = frame_seal(&header, batch->body, payload_size, device->line.frame);
    recorder_release(&device->recorder);
    return size;
}

static size_t seal_next(struct device *device)
{
    struct line *line = &device->line;
    if (line->reply_size != 0) {
        size_t size = frame_seal(&line->reply_header, line->reply_body, line->reply_size, line->frame);
        line->reply_size = 0;
        return size;
    }
    size_t size = seal_event(device);
    return size != 0 ? size : seal_batch(device);
}

const uint8_t *service_outgoing(struct device *device, size_t *size)
{
    struct line *line = &device->line;
    if (line->frame_sent == line->frame_size) {
        line->frame_sent = 0;
        line->frame_size = (uint32_t)seal_next(device);
    }
    *size = line->frame_size - line->frame_sent;
    return *size != 0 ? line->frame + line->frame_sent : NULL;
}

void service_sent(struct device *device, size_t size)
{
    device->line.frame_sent += (uint32_t)size;
}
