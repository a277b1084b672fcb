#include "footsense_can.h"

#include <string.h>

enum { LAST_STATE = FOOTSENSE_STARTING, LAST_CAUSE = 17, LAST_BASELINE_STATUS = 5, LAST_RESULT = 5,
       LAST_CALIBRATION_KIND = 3 };

enum { NO_NORMAL_CODE = -512 };

/* The word that a command spells out beside its kind, so that no stray frame is one. */
static const uint8_t words[4][4] = {
    {0, 0, 0, 0}, {'z', 'e', 'r', 'o'}, {'s', 't', 'r', 't'}, {'s', 't', 'o', 'p'}};

static uint8_t crc8_byte(uint8_t crc, uint8_t byte)
{
    crc ^= byte;
    for (int bit = 0; bit < 8; bit++) {
        crc = (uint8_t)(crc << 1 ^ (crc & 0x80 ? 0x1D : 0));
    }
    return crc;
}

uint8_t footsense_crc8(uint32_t id, const uint8_t *data, uint8_t len)
{
    uint8_t crc = crc8_byte(crc8_byte(0, (uint8_t)(id & 0xFFu)), (uint8_t)(id >> 8 & 0xFFu));
    for (uint8_t i = 1; i < len; i++) {
        crc = crc8_byte(crc, data[i]);
    }
    return crc;
}

/* The node of an id, or 0 if the id is not `base` plus a leg. */
static uint8_t node_of(uint32_t id, uint32_t base)
{
    return (id > base && id <= base + FOOTSENSE_LEGS) ? (uint8_t)(id - base) : 0;
}

static bool is_whole(uint32_t id, const uint8_t *data, uint8_t len, uint32_t base, uint8_t expected_len)
{
    return node_of(id, base) != 0 && len == expected_len && data[0] == footsense_crc8(id, data, len)
           && (data[1] & 0x0Fu) < FOOTSENSE_COUNTER_PERIOD;
}

static uint16_t u16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (uint16_t)(bytes[1] << 8));
}

static int16_t i16(const uint8_t *bytes)
{
    int32_t value = u16(bytes);
    return (int16_t)(value >= 0x8000 ? value - 0x10000 : value);
}

static int32_t force_of(const uint8_t *bytes)
{
    int16_t code = i16(bytes);
    return code == INT16_MIN ? FOOTSENSE_NO_FORCE : code;
}

/* The bits behind the crc of a frame of 8 bytes. */
static uint64_t bits_of(const uint8_t *data)
{
    uint64_t bits = 0;
    for (int i = 7; i >= 1; i--) {
        bits = bits << 8 | data[i];
    }
    return bits;
}

bool footsense_decode_force(uint32_t id, const uint8_t *data, uint8_t len, footsense_force *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_FORCE_ID, 8) || data[1] >> 4 > LAST_STATE) {
        return false;
    }
    out->node = node_of(id, FOOTSENSE_FORCE_ID);
    out->counter = data[1] & 0x0Fu;
    out->state = data[1] >> 4;
    for (int axis = 0; axis < 3; axis++) {
        out->force_mn[axis] = force_of(data + 2 + 2 * axis);
    }
    return true;
}

enum { NO_LOG = 127, LAST_LOG = 126 };

/* A number of 7 bits in eighths of an octave, in thousandths of that of code 0, rounded up. */
static uint32_t of_log(uint32_t code)
{
    static const uint64_t octave[8] = {/* 1000 times 2^(k / 8), times 2^32 */
        4294967296000u, 4683695047832u, 5107605667107u, 5569883475385u,
        6074000999952u, 6623745058664u, 7223245205676u, 7877004751727u};
    return (uint32_t)(((octave[code % 8u] << code / 8u) + UINT32_MAX) >> 32);
}

/* The code of a number in thousandths of that of code 0, rounded up. */
static uint32_t to_log(uint64_t value)
{
    uint32_t code = 0;
    while (code < LAST_LOG && of_log(code) < value) {
        code++;
    }
    return code;
}

/* A percentage of 7 bits, all set for no value. */
static uint16_t permille(uint32_t bits)
{
    uint32_t code = bits & 0x7Fu;
    return code == 0x7Fu ? FOOTSENSE_NO_RATIO : (uint16_t)(code * 10u);
}

bool footsense_decode_quality(uint32_t id, const uint8_t *data, uint8_t len, footsense_quality *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_QUALITY_ID, 8)) {
        return false;
    }
    uint64_t bits = bits_of(data);
    uint32_t age = (uint32_t)(bits >> 9) & 0xFFFu;
    out->node = node_of(id, FOOTSENSE_QUALITY_ID);
    out->counter = data[1] & 0x0Fu;
    out->flags = (uint8_t)(bits >> 4 & 0x1Fu);
    out->age_us = age == 0xFFFu ? FOOTSENSE_NO_AGE : age * 100u;
    for (unsigned axis = 0; axis < 3; axis++) {
        uint32_t code = (uint32_t)(bits >> (21 + 7 * axis)) & 0x7Fu;
        out->sigma_un[axis] = code == NO_LOG ? FOOTSENSE_NO_SIGMA_UN : of_log(code);
    }
    out->contact_permille = permille((uint32_t)(bits >> 42));
    out->holds_permille = permille((uint32_t)(bits >> 49));
    return true;
}

bool footsense_decode_fault(uint32_t id, const uint8_t *data, uint8_t len, footsense_fault *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_FAULT_ID, 6) || data[1] >> 4 > LAST_STATE
        || (data[2] & 0x0Fu) > LAST_STATE || data[5] > LAST_CAUSE) {
        return false;
    }
    out->node = node_of(id, FOOTSENSE_FAULT_ID);
    out->counter = data[1] & 0x0Fu;
    out->state = data[1] >> 4;
    out->previous = data[2] & 0x0Fu;
    out->fault_mask = u16(data + 3) & 0x1FFu;
    out->cause = data[5];
    return true;
}

static int32_t offset_af(int16_t code)
{
    return code == INT16_MIN ? FOOTSENSE_NO_OFFSET : code * 100;
}

bool footsense_decode_baseline(uint32_t id, const uint8_t *data, uint8_t len, footsense_baseline *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_BASELINE_ID, 8) || data[1] >> 4 > LAST_BASELINE_STATUS) {
        return false;
    }
    uint16_t age = u16(data + 6);
    out->node = node_of(id, FOOTSENSE_BASELINE_ID);
    out->counter = data[1] & 0x0Fu;
    out->status = data[1] >> 4;
    out->mean_af = offset_af(i16(data + 2));
    out->worst_af = offset_af(i16(data + 4));
    out->age_ms = age == 0xFFFFu ? FOOTSENSE_NO_AGE : age * 100u;
    return true;
}

bool footsense_decode_answer(uint32_t id, const uint8_t *data, uint8_t len, footsense_answer *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_ANSWER_ID, 4) || data[1] >> 4 > LAST_RESULT) {
        return false;
    }
    out->node = node_of(id, FOOTSENSE_ANSWER_ID);
    out->result = data[1] >> 4;
    out->counter = data[1] & 0x0Fu;
    out->kind = data[2];
    out->command_counter = data[3] & 0x0Fu;
    return true;
}

bool footsense_decode_gait_event(uint32_t id, const uint8_t *data, uint8_t len, footsense_gait_event *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_GAIT_EVENT_ID, 6) || data[1] >> 4 < FOOTSENSE_TOUCHDOWN
        || data[1] >> 4 > FOOTSENSE_SLIP_END) {
        return false;
    }
    uint16_t age = u16(data + 2);
    out->node = node_of(id, FOOTSENSE_GAIT_EVENT_ID);
    out->counter = data[1] & 0x0Fu;
    out->kind = data[1] >> 4;
    out->all_in_air = (data[5] & 1u) != 0;
    out->sigma_us = data[4] == 0xFFu ? FOOTSENSE_NO_SIGMA : (uint16_t)(data[4] * 200u);
    out->age_us = age == 0xFFFFu ? FOOTSENSE_NO_AGE : age * 100u;
    return true;
}

static int16_t normal_code(uint64_t bits, int shift)
{
    int32_t code = (int32_t)(bits >> shift & 0x3FFu);
    return (int16_t)(code >= 0x200 ? code - 0x400 : code);
}

/* A ratio in steps of 0.004; all bits set is no value. */
static uint16_t ratio(uint64_t bits, int shift, uint32_t mask)
{
    uint32_t code = (uint32_t)(bits >> shift) & mask;
    return code == mask ? FOOTSENSE_NO_RATIO : (uint16_t)(code * 4u);
}

bool footsense_decode_ground(uint32_t id, const uint8_t *data, uint8_t len, footsense_ground *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_GROUND_ID, 8)) {
        return false;
    }
    uint64_t bits = bits_of(data);
    int16_t x = normal_code(bits, 4);
    int16_t y = normal_code(bits, 14);
    bool known = x != NO_NORMAL_CODE && y != NO_NORMAL_CODE;
    uint32_t sigma = (uint32_t)(bits >> 24) & 0x7Fu;
    out->node = node_of(id, FOOTSENSE_GROUND_ID);
    out->counter = data[1] & 0x0Fu;
    out->normal_permille[0] = known ? (int16_t)(x * 2) : FOOTSENSE_NO_NORMAL;
    out->normal_permille[1] = known ? (int16_t)(y * 2) : FOOTSENSE_NO_NORMAL;
    out->normal_sigma_urad = sigma == 0x7Fu ? UINT32_MAX : sigma * 2500u;
    out->tangential_over_normal_permille = ratio(bits, 31, 0x1FFu);
    out->tangential_over_normal_sigma_permille = ratio(bits, 40, 0x3Fu);
    out->friction_permille = ratio(bits, 46, 0x1FFu);
    return true;
}

bool footsense_decode_identity(uint32_t id, const uint8_t *data, uint8_t len, footsense_identity *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_IDENTITY_ID, 8)) {
        return false;
    }
    out->node = node_of(id, FOOTSENSE_IDENTITY_ID);
    out->counter = data[1] & 0x0Fu;
    out->version = data[2];
    out->force_step_mn = data[3];
    out->foot_type_hash = u16(data + 4) | (uint32_t)u16(data + 6) << 16;
    return true;
}

bool footsense_decode_calibration(uint32_t id, const uint8_t *data, uint8_t len, footsense_calibration *out)
{
    if (!is_whole(id, data, len, FOOTSENSE_CALIBRATION_ID, 6) || data[1] >> 4 > LAST_CALIBRATION_KIND) {
        return false;
    }
    out->node = node_of(id, FOOTSENSE_CALIBRATION_ID);
    out->counter = data[1] & 0x0Fu;
    out->kind = data[1] >> 4;
    out->day = u16(data + 2);
    out->size_error_permille = data[4] == 0xFFu ? FOOTSENSE_NO_RATIO : (uint16_t)(data[4] * 5u);
    out->direction_error_ddeg = data[5] == 0xFFu ? FOOTSENSE_NO_RATIO : data[5];
    return true;
}

bool footsense_decode_heartbeat(uint32_t id, const uint8_t *data, uint8_t len, footsense_heartbeat *out)
{
    if (node_of(id, FOOTSENSE_HEARTBEAT_ID) == 0 || len != 1) {
        return false;
    }
    uint8_t state = data[0] & 0x7Fu;
    if (state != 0x00u && state != 0x04u && state != 0x05u && state != 0x7Fu) {
        return false;
    }
    out->node = node_of(id, FOOTSENSE_HEARTBEAT_ID);
    out->state = state;
    out->degraded_timing = (data[0] & 0x80u) != 0;
    return true;
}

uint16_t footsense_encode_command(uint8_t node, uint8_t counter, uint8_t kind, uint8_t data[8])
{
    if (node < 1 || node > FOOTSENSE_LEGS || counter >= FOOTSENSE_COUNTER_PERIOD || kind < FOOTSENSE_TARE
        || kind > FOOTSENSE_STOP) {
        return 0;
    }
    uint16_t id = (uint16_t)(FOOTSENSE_COMMAND_ID + node);
    data[1] = counter;
    data[2] = kind;
    data[3] = 0;
    memcpy(data + 4, words[kind], 4);
    data[0] = footsense_crc8(id, data, 8);
    return id;
}

uint16_t footsense_encode_motion(uint8_t node, uint8_t counter, const footsense_motion *motion, uint8_t data[8])
{
    int32_t x = motion->up_permille[0];
    int32_t y = motion->up_permille[1];
    bool has_up = x != FOOTSENSE_NO_NORMAL && y != FOOTSENSE_NO_NORMAL;
    if (node < 1 || node > FOOTSENSE_LEGS || counter >= FOOTSENSE_COUNTER_PERIOD
        || motion->phase > FOOTSENSE_PHASE_STANCE || (has_up && x * x + y * y > 1000000)) {
        return 0;
    }
    uint16_t id = (uint16_t)(FOOTSENSE_LEG_MOTION_ID + node);
    uint64_t sigma = motion->sigma_mm_per_s2 == FOOTSENSE_NO_ACCELERATION_SIGMA
                         ? NO_LOG
                         : to_log(motion->sigma_mm_per_s2 * (uint64_t)100);
    uint64_t up = has_up ? ((uint64_t)x & 0x7FFu) | ((uint64_t)y & 0x7FFu) << 11 : 0x400u | 0x400u << 11;
    uint64_t bits = (uint64_t)counter | (uint64_t)motion->phase << 4
                    | (uint64_t)(uint16_t)motion->acceleration_cm_per_s2 << 8 | sigma << 24 | up << 31;
    for (int i = 1; i < 8; i++) {
        data[i] = (uint8_t)(bits & 0xFFu);
        bits >>= 8;
    }
    data[0] = footsense_crc8(id, data, 8);
    return id;
}
