#include "footsense_scan.h"

#include <string.h>

/* Registers of the AD7147, as firmware_interface/chips/ad7147.py, which has their sources. */
enum {
    PWR_CONTROL = 0x000,
    AMB_COMP_CTRL0 = 0x002,
    STAGE_COMPLETE_INT_ENABLE = 0x007,
    STAGE_COMPLETE_INT_STATUS = 0x00A,
    DEVICE_ID_REGISTER = 0x017,
    STAGE0_CONNECTION = 0x080,
    REGISTERS_PER_STAGE = 8,
    DEVICE_ID = 0x1470,
    DEVICE_ID_MASK = 0xFFF0,
    SW_RESET = 0x0400,
    CONV_RESET = 0x8000,
    DECIMATION_64 = 0x0200,
    STATUS = 0x0FFF,
    NOT_NO_STAGE = 0xEFFF, /* without the bit of a status that is no stage's; those above it are zero */
    CODE_MID = 0x8000,
    CODE_MAX = 0xFFFF,
    MAX_OFFSET = 63
};

/* The set-up of a leg, a transaction a step; then it is read. */
enum {
    IDENTIFY,
    RESET,
    REFERENCE_STAGES,                               /* a step for each stage */
    REFERENCE_CONTROL = REFERENCE_STAGES + 12,
    REFERENCE_ENABLE,
    REFERENCE_START,
    REFERENCE_READ,
    CHECK_CONTROL,                                  /* a leg whose status did not fit goes on from here */
    ELEMENT_STAGES,
    ELEMENT_CONTROL = ELEMENT_STAGES + FOOTSENSE_STAGES,
    ELEMENT_ENABLE,
    ELEMENT_START,
    READ
};

enum {
    REFERENCE_INPUT = 12,
    N_REFERENCE = 12, /* stages, half of them without offset */
    HALF = N_REFERENCE / 2,
    REFERENCE_AF = 4700000,
    MAX_REFERENCE_ERROR_AF = REFERENCE_AF * 3 / 10,
    MAX_REFERENCE_SPREAD = 100, /* codes */
    RANGE_START_AF = 2600000,
    FIRST_OFFSET = 33,
    RESET_NS = 1000000,
    PAUSE_NS = 250000000,
    SILENT_SCANS = 14, /* 70 ms without a value: its chip is set up from its reset on */
    MAX_DOUBTS = 2,
    MAX_TRIES = 4,
    SET_UP_US = 3600, /* of a scan */
    N_CHECKS = 1 + FOOTSENSE_STAGES,
    ALL = (1 << FOOTSENSE_STAGES) - 1,
    /* The legs of a scan are not farther apart: half a scan less what their starts may differ. */
    APART_NS = 400 * FOOTSENSE_SCAN_US,
    LATEST_NS = 9 * FOOTSENSE_LONGEST_STAGE_NS,
    /* From the start of a read to its first word, and of the results behind it, at the chip's fastest clock. */
    WORD_AFTER_NS = 39 * 2250,
    RESULTS_NS = 162 * 2250
};

/* Elements in the order of their stages: Lo-Shu. */
static const uint8_t ORDER[FOOTSENSE_STAGES] = {5, 0, 7, 6, 4, 2, 1, 8, 3};

static uint16_t word_at(const uint8_t *bytes, unsigned n)
{
    return (uint16_t)(bytes[2 * n] << 8 | bytes[2 * n + 1]);
}

static uint32_t bit(unsigned leg)
{
    return 1u << leg;
}

static int64_t now_ns(footsense_scan *scan)
{
    uint32_t us = (uint32_t)(scan->now_ns / 1000);
    scan->now_ns += (int64_t)(footsense_now_us() - us) * 1000;
    return scan->now_ns;
}

static void leave(footsense_scan *scan, unsigned leg, uint8_t reason)
{
    footsense_scan_leg *l = &scan->legs[leg];
    l->reason = reason;
    l->step = IDENTIFY;
    l->due_ns = now_ns(scan) + PAUSE_NS;
}

/* A transaction; legs that hold a line low are left out. */
static uint8_t transfer(footsense_scan *scan, uint8_t legs, const uint8_t *out, unsigned n_out,
                        uint8_t in[][FOOTSENSE_READ_MAX], unsigned n_in)
{
    if (legs == 0) {
        return 0;
    }
    footsense_answer answer = footsense_transfer(legs, out, (uint8_t)n_out, in, (uint8_t)n_in);
    scan->stuck = answer.stuck;
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        if (answer.stuck & bit(leg)) {
            leave(scan, leg, FOOTSENSE_BUS_STUCK);
        }
    }
    return (uint8_t)(answer.answered & ~answer.stuck);
}

static uint8_t read_words(footsense_scan *scan, uint8_t legs, unsigned from, uint8_t in[][FOOTSENSE_READ_MAX], unsigned n)
{
    uint8_t address[2] = {(uint8_t)(from >> 8), (uint8_t)from};
    return transfer(scan, legs, address, 2, in, 2 * n);
}

static bool write_words(footsense_scan *scan, unsigned leg, unsigned from, const uint16_t *words, unsigned n)
{
    uint8_t out[8] = {(uint8_t)(from >> 8), (uint8_t)from};
    for (unsigned k = 0; k < n; k++) {
        out[2 * k + 2] = (uint8_t)(words[k] >> 8);
        out[2 * k + 3] = (uint8_t)words[k];
    }
    return transfer(scan, (uint8_t)bit(leg), out, 2 * n + 2, NULL, 0) != 0;
}

/* A stage that converts an input: the others carry the excitation, as the shield does. */
static void stage_words(unsigned input, unsigned offset, uint16_t words[3])
{
    uint32_t connections = 0x3FFFFFFu ^ 1u << 2 * input; /* 3: the excitation; 2: the positive input of the converter */
    words[0] = (uint16_t)(connections & 0x3FFFu);
    words[1] = (uint16_t)(connections >> 14 | 0x1000u); /* single-ended, at the positive input */
    words[2] = (uint16_t)(offset << 8);
}

/* The sequence's length and speed; the second word turns the calibration engine off. */
static const uint16_t ELEMENT_POWER[2] = {(FOOTSENSE_STAGES - 1) << 4 | DECIMATION_64, 0};
static const uint16_t REFERENCE_POWER[2] = {(N_REFERENCE - 1) << 4 | DECIMATION_64, 0};

/* Reads what the codes of a chip are worth. */
static void measure_reference(footsense_scan *scan, unsigned leg)
{
    footsense_scan_leg *l = &scan->legs[leg];
    uint8_t in[FOOTSENSE_LEGS][FOOTSENSE_READ_MAX];
    int32_t sum[2] = {0, 0};
    uint8_t reason = FOOTSENSE_NO_ANSWER;
    if (read_words(scan, (uint8_t)bit(leg), STAGE_COMPLETE_INT_STATUS, in, 1 + N_REFERENCE)) {
        reason = (word_at(in[leg], 0) & STATUS) == STATUS ? 0 : FOOTSENSE_NOT_READY;
        for (unsigned half = 0; half < 2; half++) {
            uint16_t least = CODE_MAX, most = 0;
            for (unsigned k = 0; k < HALF; k++) {
                uint16_t code = word_at(in[leg], 1 + HALF * half + k);
                sum[half] += code - CODE_MID;
                least = code < least ? code : least;
                most = code > most ? code : most;
            }
            if (reason == 0 && most - least > MAX_REFERENCE_SPREAD) {
                reason = FOOTSENSE_CORRUPT;
            }
        }
    }
    if (scan->stuck) {
        return;
    }
    if (reason != 0) {
        l->reason = reason;
        l->due_ns = now_ns(scan) + (N_REFERENCE + 1) * FOOTSENSE_LONGEST_STAGE_NS;
        if (++l->n_misses > MAX_TRIES) {
            leave(scan, leg, reason);
        }
        return;
    }
    int32_t without = sum[0] > HALF ? sum[0] : HALF;
    int64_t nominal_af = (int64_t)without * 15625 / (64 * HALF); /* 16 pF over 2^16 a code */
    int64_t offset_af = (int64_t)REFERENCE_AF * (sum[0] - sum[1]) / without;
    if (nominal_af < REFERENCE_AF - MAX_REFERENCE_ERROR_AF || nominal_af > REFERENCE_AF + MAX_REFERENCE_ERROR_AF
        || offset_af <= 0) {
        leave(scan, leg, FOOTSENSE_MISCONFIGURED);
        return;
    }
    int64_t half_range_af = (int64_t)REFERENCE_AF * HALF * CODE_MID / without;
    int64_t best = (l->offset * (RANGE_START_AF + half_range_af) + offset_af / 2) / offset_af;
    best = best < MAX_OFFSET ? best : MAX_OFFSET;
    if (best > l->offset + 1 || best < l->offset - 1) {
        l->offset = (uint8_t)best;
        l->step = REFERENCE_STAGES;
        return;
    }
    l->gain_q12 = (int32_t)(((int64_t)REFERENCE_AF * HALF << 12) / without);
    l->offset_af = (int32_t)offset_af;
    l->step = ELEMENT_STAGES;
    l->reason = FOOTSENSE_NOT_READY;
    l->n_misses = 0;
}

/* Does the next step of a leg's set-up; false if it is not due. */
static bool set_up(footsense_scan *scan, unsigned leg)
{
    footsense_scan_leg *l = &scan->legs[leg];
    uint8_t in[FOOTSENSE_LEGS][FOOTSENSE_READ_MAX], step = l->step;
    uint16_t words[3] = {0, 0, 0};
    int64_t begin_ns = now_ns(scan);
    bool done = false;
    if (step == READ || begin_ns < l->due_ns) {
        return false;
    }
    if (step == IDENTIFY) {
        done = read_words(scan, (uint8_t)bit(leg), DEVICE_ID_REGISTER, in, 1) != 0;
        if (done && (word_at(in[leg], 0) & DEVICE_ID_MASK) != DEVICE_ID) {
            leave(scan, leg, FOOTSENSE_WRONG_CHIP);
            return true;
        }
    } else if (step == RESET) {
        words[0] = SW_RESET;
        done = write_words(scan, leg, PWR_CONTROL, words, 1);
        l->due_ns = begin_ns + RESET_NS;
        l->n_misses = 0;
        l->offset = FIRST_OFFSET;
    } else if (step < REFERENCE_CONTROL) {
        unsigned stage = (unsigned)step - REFERENCE_STAGES;
        stage_words(REFERENCE_INPUT, stage < HALF ? 0 : l->offset, words);
        done = write_words(scan, leg, STAGE0_CONNECTION + REGISTERS_PER_STAGE * stage, words, 3);
    } else if (step == REFERENCE_CONTROL || step == ELEMENT_CONTROL) {
        done = write_words(scan, leg, PWR_CONTROL, step == ELEMENT_CONTROL ? ELEMENT_POWER : REFERENCE_POWER, 2);
    } else if (step == REFERENCE_ENABLE || step == ELEMENT_ENABLE) {
        words[0] = step == ELEMENT_ENABLE ? ALL : (1 << N_REFERENCE) - 1;
        done = write_words(scan, leg, STAGE_COMPLETE_INT_ENABLE, words, 1);
    } else if (step == REFERENCE_START) {
        words[0] = CONV_RESET;
        done = write_words(scan, leg, AMB_COMP_CTRL0, words, 1);
        l->due_ns = begin_ns + (int64_t)3 * N_REFERENCE * FOOTSENSE_LONGEST_STAGE_NS;
    } else if (step == REFERENCE_READ) {
        measure_reference(scan, leg);
        return true;
    } else if (step == CHECK_CONTROL) {
        done = read_words(scan, (uint8_t)bit(leg), PWR_CONTROL, in, 2) != 0;
        if (done && (word_at(in[leg], 0) != ELEMENT_POWER[0] || word_at(in[leg], 1) != ELEMENT_POWER[1])) {
            l->reason = FOOTSENSE_MISCONFIGURED;
        } else if (done && l->n_doubts <= MAX_DOUBTS) {
            footsense_stages_trust(&l->stages);
            l->step = READ;
            return true;
        }
    } else if (step < ELEMENT_CONTROL) {
        unsigned stage = (unsigned)step - ELEMENT_STAGES;
        stage_words(ORDER[stage], l->offset, words);
        done = write_words(scan, leg, STAGE0_CONNECTION + REGISTERS_PER_STAGE * stage, words, 3);
    } else {
        words[0] = CONV_RESET;
        done = write_words(scan, leg, AMB_COMP_CTRL0, words, 1);
        footsense_stages_start(&l->stages, (footsense_span){begin_ns, now_ns(scan) + 1000});
        /* The status still has bits of the sequence before. */
        done = read_words(scan, (uint8_t)bit(leg), STAGE_COMPLETE_INT_STATUS, in, 1) != 0 && done;
        footsense_stages_miss(&l->stages, now_ns(scan) + 1000);
        l->n_doubts = 0;
    }
    if (scan->stuck) {
        return true;
    }
    if (done) {
        l->step++;
    } else if (step < CHECK_CONTROL) {
        leave(scan, leg, FOOTSENSE_NO_ANSWER);
    } else {
        l->reason = FOOTSENSE_NO_ANSWER;
        l->due_ns = begin_ns + RESET_NS;
    }
    return true;
}

/* Takes the burst of a leg, with the status behind it; false if it is to be read again. */
static bool take(footsense_scan_leg *l, const uint8_t *burst, footsense_span before_at, const uint8_t *behind,
                 footsense_span behind_at)
{
    uint16_t code[FOOTSENSE_STAGES];
    for (unsigned k = 0; k < FOOTSENSE_STAGES; k++) {
        code[k] = word_at(burst, 1 + k);
    }
    uint16_t before = word_at(burst, 0) & NOT_NO_STAGE;
    footsense_taken taken = footsense_stages_take(&l->stages, before, before_at, code,
                                                  word_at(behind, 0) & NOT_NO_STAGE, behind_at);
    l->is_new = taken == FOOTSENSE_TAKEN;
    if (taken == FOOTSENSE_DOUBT) {
        l->n_doubts++;
        l->reason = FOOTSENSE_NOT_READY;
        l->step = CHECK_CONTROL;
    } else if (l->is_new) {
        l->n_doubts = 0;
    }
    return taken != FOOTSENSE_AGAIN;
}

/* Reads legs at the same time; returns those that are to be read again. */
static uint8_t read_legs(footsense_scan *scan, uint8_t legs)
{
    uint8_t burst[FOOTSENSE_LEGS][FOOTSENSE_READ_MAX], status[FOOTSENSE_LEGS][FOOTSENSE_READ_MAX];
    int64_t begin_ns = now_ns(scan);
    uint8_t left = read_words(scan, legs, STAGE_COMPLETE_INT_STATUS, burst, 1 + FOOTSENSE_STAGES);
    uint8_t again = (uint8_t)(legs & ~left);
    footsense_span before_at = {begin_ns + WORD_AFTER_NS, now_ns(scan) + 1000 - RESULTS_NS};
    for (int attempt = 0; attempt < 2 && left != 0; attempt++) {
        begin_ns = now_ns(scan);
        uint8_t read = read_words(scan, left, STAGE_COMPLETE_INT_STATUS, status, 1);
        footsense_span behind_at = {begin_ns + WORD_AFTER_NS, now_ns(scan) + 1000};
        for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
            if (read & bit(leg) && !take(&scan->legs[leg], burst[leg], before_at, status[leg], behind_at)) {
                again = (uint8_t)(again | bit(leg));
            }
        }
        left = (uint8_t)(left & ~read);
    }
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        if ((left | again) & bit(leg) && scan->legs[leg].step == READ) {
            footsense_stages_miss(&scan->legs[leg].stages, now_ns(scan) + 1000);
            scan->legs[leg].reason = FOOTSENSE_NO_ANSWER;
        }
    }
    return again;
}

static uint8_t legs_that_are_read(const footsense_scan *scan)
{
    uint8_t legs = 0;
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        if (scan->legs[leg].step == READ) {
            legs = (uint8_t)(legs | bit(leg));
        }
    }
    return legs;
}

static int32_t value_af(const footsense_scan_leg *l, uint16_t code)
{
    if (code == 0 || code == CODE_MAX) {
        return FOOTSENSE_NO_VALUE(code == 0 ? FOOTSENSE_UNDER_RANGE : FOOTSENSE_OVER_RANGE);
    }
    return l->offset_af + (int32_t)((int64_t)(code - CODE_MID) * l->gain_q12 / 4096);
}

/* Sends the records of all legs; those without new values have the time of the others. */
static void send_records(footsense_scan *scan)
{
    footsense_run runs[FOOTSENSE_LEGS];
    int64_t newest_ns = now_ns(scan) - LATEST_NS;
    uint8_t *records = scan->sent + FOOTSENSE_SENDING_BYTES, *out = records;
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        if (!scan->legs[leg].is_new) {
            runs[leg] = (footsense_run){.missing = ALL};
            continue;
        }
        runs[leg] = footsense_stages_newest(&scan->legs[leg].stages);
        if (runs[leg].missing != ALL) {
            newest_ns = runs[leg].t_ns > newest_ns ? runs[leg].t_ns : newest_ns;
        }
    }
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        footsense_scan_leg *l = &scan->legs[leg];
        footsense_record record = {.leg = (uint8_t)(leg + 1), .flags = FOOTSENSE_LO_SHU, .seq = l->seq};
        bool has_run = runs[leg].missing != ALL && runs[leg].t_ns >= newest_ns - APART_NS;
        uint16_t missing = has_run ? runs[leg].missing : ALL;
        record.t_us = (uint32_t)((has_run ? runs[leg].t_ns : newest_ns) / 1000);
        for (unsigned k = 0; k < FOOTSENSE_STAGES; k++) {
            unsigned stage = has_run ? (runs[leg].first + k) % FOOTSENSE_STAGES : k;
            record.value_af[ORDER[stage]] = missing >> k & 1 ? FOOTSENSE_NO_VALUE(l->reason)
                                                             : value_af(l, runs[leg].code[k]);
        }
        if (has_run) {
            record.step_us = (uint16_t)((runs[leg].step_ns + 500) / 1000);
            record.flags = (uint8_t)(record.flags | FOOTSENSE_BEGAN_AT(runs[leg].first));
        }
        if (l->starting) {
            record.flags = (uint8_t)(record.flags | FOOTSENSE_RECORD_STARTING);
        }
        l->starting = l->starting && l->seq < 255;
        l->seq++;
        l->reason = missing == 0 ? FOOTSENSE_NOT_READY : l->reason;
        /* A chip whose status fits converts, though the time of its conversions may not be known yet. */
        l->n_misses = l->is_new ? 0 : l->step > REFERENCE_READ ? (uint8_t)(l->n_misses + 1) : l->n_misses;
        l->is_new = false;
        if (l->step > REFERENCE_READ && l->n_misses > SILENT_SCANS) {
            leave(scan, leg, l->reason);
        }
        out += footsense_encode_record(&record, out);
    }
    const char *text = "";
    for (int byte = footsense_receive(); byte >= 0; byte = footsense_receive()) {
        text = byte == FOOTSENSE_IDENTIFY ? footsense_identity : text;
    }
    /* The time is that of the first byte. */
    uint8_t head[FOOTSENSE_SENDING_BYTES];
    uint8_t n_head = footsense_encode_sending(footsense_now_us(), text, head);
    memcpy(records - n_head, head, n_head);
    footsense_send(records - n_head, (uint16_t)(out - records + n_head));
}

/* Reads back settings of all legs that are read, a block of registers a scan. */
static void check_settings(footsense_scan *scan)
{
    uint8_t in[FOOTSENSE_LEGS][FOOTSENSE_READ_MAX];
    unsigned stage = scan->check - 1u, from = STAGE0_CONNECTION + REGISTERS_PER_STAGE * stage, n = 3;
    if (scan->check == 0) {
        from = PWR_CONTROL;
        n = 2;
    }
    uint8_t wrong = legs_that_are_read(scan);
    for (int attempt = 0; attempt < 2 && wrong != 0; attempt++) {
        wrong = read_words(scan, wrong, from, in, n);
        for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
            uint16_t words[3] = {ELEMENT_POWER[0], ELEMENT_POWER[1], 0};
            bool held = true;
            if (scan->check != 0) {
                stage_words(ORDER[stage], scan->legs[leg].offset, words);
            }
            for (unsigned k = 0; k < n; k++) {
                held = held && word_at(in[leg], k) == words[k];
            }
            wrong = (uint8_t)(held ? wrong & ~bit(leg) : wrong);
        }
    }
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        if (wrong & bit(leg)) {
            scan->legs[leg].reason = FOOTSENSE_MISCONFIGURED;
            scan->legs[leg].step = ELEMENT_STAGES;
        }
    }
    scan->check = (uint8_t)((scan->check + 1) % N_CHECKS);
}

void footsense_scan_start(footsense_scan *scan)
{
    memset(scan, 0, sizeof *scan);
    scan->next_us = footsense_now_us();
    scan->now_ns = (int64_t)scan->next_us * 1000;
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        scan->legs[leg].starting = true;
        scan->legs[leg].reason = FOOTSENSE_NO_ANSWER;
    }
}

void footsense_scan_next(footsense_scan *scan)
{
    footsense_wait_until_us(scan->next_us);
    uint32_t start_us = footsense_now_us();
    /* The next scan begins a period later; after a delay by more than that, anew. */
    scan->next_us = (start_us - scan->next_us < FOOTSENSE_SCAN_US ? scan->next_us : start_us) + FOOTSENSE_SCAN_US;
    uint8_t again = read_legs(scan, legs_that_are_read(scan));
    again &= legs_that_are_read(scan);
    if (again != 0) {
        (void)read_legs(scan, again);
    }
    send_records(scan);
    check_settings(scan);
    for (unsigned n = 0, idle = 0; idle < FOOTSENSE_LEGS && footsense_now_us() - start_us < SET_UP_US; n++) {
        idle = set_up(scan, (scan->first + n) % FOOTSENSE_LEGS) ? 0 : idle + 1;
    }
    scan->first = (uint8_t)((scan->first + 1) % FOOTSENSE_LEGS);
}
