/* Firmware over the wire: update.h says how. */
#include <string.h>

#include "app/axes.h"
#include "app/command.h"
#include "app/crc32.h"
#include "app/reaction.h"

static bool is_at_zero(const struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++)
        if (device->control.axis[axis].u_q24 != 0)
            return false;
    return true;
}

/* A restart clears the outputs, and an erase holds them: both only from 0 V. A fault that holds keeps its outputs. */
static enum wire_status go_to_zero(struct device *device)
{
    enum wire_status status = WIRE_STATUS_OK;
    device_lock(device);
    if (!is_at_zero(device) && device->control.state != WIRE_STATE_PARKED) {
        status = WIRE_STATUS_WRONG_STATE;
    } else if (!is_at_zero(device)) {
        for (unsigned axis = 0; axis < AXES; axis++)
            device->control.config[axis].u_park_q24 = 0;
        axes_leave_paths(device, DRIVE_RAMP);
        status = WIRE_STATUS_BUSY;
    }
    device_unlock(device);
    return status;
}

static unsigned free_slot(const struct device *device)
{
    return 1u - device->port.update.slot;
}

static enum wire_status flash_failed(struct device *device, struct answer *answer)
{
    device_lock(device);
    answer->tick = device->control.tick;
    device_fault(device, WIRE_FAULT_FLASH_ERROR, NO_AXIS, 0);
    device_unlock(device);
    device->update.receiving = false;
    return WIRE_STATUS_FLASH_FAILED;
}

enum wire_status command_update_info(struct device *device, const struct request *request, struct answer *answer)
{
    const struct update_port *port = &device->port.update;
    struct update *update = &device->update;
    struct wire_update_info_reply reply = {0};
    struct image_header header;
    (void)request;
    reply.slot = port->slot;
    reply.standing = update->on_trial      ? WIRE_UPDATE_STANDING_TRIAL
                     : update->rolled_back ? WIRE_UPDATE_STANDING_ROLLED_BACK
                                           : WIRE_UPDATE_STANDING_CONFIRMED;
    reply.slot_size = port->places.slot_size;
    reply.free_address = port->places.address[free_slot(device)];
    reply.trial_ticks = UPDATE_TRIAL_TICKS;
    reply.attempts = BOOT_ATTEMPTS;
    port->flash.read(port->flash.context, port->slot, 0, (uint8_t *)&header, sizeof header);
    reply.version = header.magic == IMAGE_MAGIC ? header.version : 0;
    wire_pack_update_info_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}

static bool is_for_this_device(const struct device *device, const struct image_header *header)
{
    const struct update_port *port = &device->port.update;
    return image_header_is_sound(header, port->places.address[free_slot(device)], port->places.slot_size) &&
           strncmp(header->target, device->port.target, IMAGE_TARGET_SIZE) == 0;
}

/* The sector of the record is erased while the slot that runs is the only one with an image: without a record it is
 * what will be started. */
static bool make_room(struct device *device)
{
    const struct flash_port *flash = &device->port.update.flash;
    struct boot_record *record = &device->update.record;
    if (!flash->erase(flash->context, free_slot(device)))
        return false;
    if (!boot_record_needs_room(record))
        return true;
    if (!flash->erase(flash->context, BOOT_RECORD_SLOT))
        return false;
    *record = (struct boot_record){.confirmed = BOOT_NO_SLOT, .trial = BOOT_NO_SLOT};
    return boot_record_append(flash, record, BOOT_CONFIRMED, device->port.update.slot, 0) &&
           boot_record_settle(flash, record);
}

enum wire_status command_update_begin(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_update_begin_request begin;
    struct update *update = &device->update;
    struct image_header header;
    wire_unpack_update_begin_request(&begin, request->payload, request->size);
    if (update->on_trial)
        return WIRE_STATUS_WRONG_STATE;
    memcpy(&header, begin.header, sizeof header);
    if (!is_for_this_device(device, &header))
        return WIRE_STATUS_BAD_VALUE;
    enum wire_status status = go_to_zero(device);
    if (status != WIRE_STATUS_OK)
        return status;
    update->header = header;
    update->receiving = true;
    update->rolled_back = false;
    return make_room(device) ? WIRE_STATUS_OK : flash_failed(device, answer);
}

enum wire_status command_update_chunk(struct device *device, const struct request *request, struct answer *answer)
{
    const struct update_port *port = &device->port.update;
    struct update *update = &device->update;
    struct wire_update_chunk_request chunk;
    wire_unpack_update_chunk_request(&chunk, request->payload, request->size);
    if (!update->receiving || !is_at_zero(device)) /* it may have been armed and parked meanwhile */
        return WIRE_STATUS_WRONG_STATE;
    if (chunk.offset < IMAGE_HEADER_SIZE || chunk.offset > update->header.length ||
        chunk.data_size > update->header.length - chunk.offset)
        return WIRE_STATUS_BAD_VALUE;
    if (!flash_program_verified(&port->flash, free_slot(device), chunk.offset, chunk.data, chunk.data_size))
        return flash_failed(device, answer);
    return WIRE_STATUS_OK;
}

enum wire_status command_update_commit(struct device *device, const struct request *request, struct answer *answer)
{
    const struct update_port *port = &device->port.update;
    struct update *update = &device->update;
    const uint8_t *header = (const uint8_t *)&update->header;
    unsigned slot = free_slot(device);
    (void)request;
    if (!update->receiving || !is_at_zero(device))
        return WIRE_STATUS_WRONG_STATE;
    uint32_t crc = crc32(0, header + IMAGE_CRC_FROM, IMAGE_HEADER_SIZE - IMAGE_CRC_FROM);
    if (image_crc(&port->flash, slot, crc, IMAGE_HEADER_SIZE, update->header.length) != update->header.crc)
        return WIRE_STATUS_CRC_MISMATCH;
    update->receiving = false;
    if (!flash_program_verified(&port->flash, slot, 0, header, IMAGE_HEADER_SIZE) ||
        !boot_record_append(&port->flash, &update->record, BOOT_TRIAL, slot, update->header.crc))
        return flash_failed(device, answer);
    return WIRE_STATUS_OK;
}

enum wire_status command_update_restart(struct device *device, const struct request *request, struct answer *answer)
{
    (void)request;
    (void)answer;
    enum wire_status status = go_to_zero(device);
    if (status != WIRE_STATUS_OK)
        return status;
    device->update.restart_tick = device->control.tick + UPDATE_RESTART_TICKS;
    device->update.restarting = true;
    return WIRE_STATUS_OK;
}

enum wire_status command_update_confirm(struct device *device, const struct request *request, struct answer *answer)
{
    const struct update_port *port = &device->port.update;
    struct update *update = &device->update;
    struct wire_update_confirm_request confirm;
    wire_unpack_update_confirm_request(&confirm, request->payload, request->size);
    if (memcmp(confirm.build_id, device->port.build_id, sizeof confirm.build_id) != 0)
        return WIRE_STATUS_BAD_VALUE;
    if (!update->on_trial)
        return WIRE_STATUS_OK;
    if (!boot_record_append(&port->flash, &update->record, BOOT_CONFIRMED, port->slot, 0) ||
        !boot_record_settle(&port->flash, &update->record))
        return flash_failed(device, answer);
    update->on_trial = false;
    return WIRE_STATUS_OK;
}
