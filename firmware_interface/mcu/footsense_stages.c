#include "footsense_stages.h"

#include <string.h>

enum {
    SHORTEST_NS = 2 * FOOTSENSE_STAGE_NS - FOOTSENSE_LONGEST_STAGE_NS,
    /* No source says whether a stage's status or its result changes first. */
    SKEW_NS = 100000,
    N_UNUSED = 2 * FOOTSENSE_STAGES, /* the first results of a new configuration may be junk */
    ALL = (1 << FOOTSENSE_STAGES) - 1,
    SLOTS = 16,
    /* Conversions after which numbers begin anew: a multiple of stages and of slots; how much the time of a stage may
     * have drifted in them, as a divisor. */
    PERIOD = 7 * SLOTS * FOOTSENSE_STAGES,
    DRIFT_DIVISOR = 2000,
    NEGLIGIBLE_NS = 40000, /* what a status has to narrow the bounds by */
    UNIT = 256, /* units of the time of a stage in a nanosecond */
    NONE = INT32_MIN
};

static const footsense_span ANY_STAGE = {0, INT64_MAX};

static int64_t max64(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

static int64_t min64(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static int max(int a, int b)
{
    return a > b ? a : b;
}

static int min(int a, int b)
{
    return a < b ? a : b;
}

static int stage_of(int number)
{
    return number % FOOTSENSE_STAGES;
}

static int n_stages_of(uint16_t status)
{
    int n = 0;
    for (unsigned bits = status; bits != 0; bits &= bits - 1) {
        n++;
    }
    return n;
}

/* When `n` more conversions had ended, if a corner is right. */
static int64_t at_corner(const footsense_stages *stages, int corner, int n)
{
    return stages->base + stages->corner[corner].ended + (int64_t)n * stages->corner[corner].stage / UNIT;
}

/* When a number of conversions had ended. */
static footsense_span ended(const footsense_stages *stages, int number)
{
    footsense_span span = {INT64_MAX, INT64_MIN};
    for (int k = 0; k < stages->n_corners; k++) {
        int64_t at = at_corner(stages, k, number - stages->origin);
        span = (footsense_span){min64(span.from, at), max64(span.to, at)};
    }
    return span;
}

/* The time of a stage in units. */
static footsense_span stage_time(const footsense_stages *stages)
{
    footsense_span span = {INT64_MAX, 0};
    for (int k = 0; k < stages->n_corners; k++) {
        span = (footsense_span){min64(span.from, stages->corner[k].stage), max64(span.to, stages->corner[k].stage)};
    }
    return span;
}

/* Any two times are possible: of when a number of conversions had ended, and of a stage. */
static void assume(footsense_stages *stages, int number, footsense_span at, footsense_span stage)
{
    int32_t shortest = (int32_t)max64(stage.from, (int64_t)SHORTEST_NS * UNIT), width = (int32_t)(at.to - at.from);
    int32_t longest = (int32_t)min64(stage.to, (int64_t)FOOTSENSE_LONGEST_STAGE_NS * UNIT);
    footsense_corner corners[4] = {{0, shortest}, {width, shortest}, {width, longest}, {0, longest}};
    memcpy(stages->corner, corners, sizeof corners);
    stages->n_corners = 4;
    stages->origin = number;
    stages->base = at.from;
}

/* Takes from the polygon what contradicts that a number of conversions had ended at a time at the latest (sign 1), or at
 * the earliest (-1). */
static void cut(footsense_stages *stages, int number, int64_t at, int sign)
{
    footsense_corner kept[2 * FOOTSENSE_CORNERS];
    int n_kept = 0, n = number - stages->origin, other = stages->n_corners - 1;
    for (int k = 0; k < stages->n_corners; other = k++) {
        const footsense_corner *here = &stages->corner[k], *there = &stages->corner[other];
        int64_t spare = sign * (at - at_corner(stages, k, n)), spare_there = sign * (at - at_corner(stages, other, n));
        if ((spare < 0) != (spare_there < 0)) {
            int64_t whole = spare - spare_there;
            kept[n_kept].ended = here->ended + (int32_t)(spare * (there->ended - here->ended) / whole);
            kept[n_kept++].stage = here->stage + (int32_t)(spare * (there->stage - here->stage) / whole);
        }
        if (spare >= 0) {
            kept[n_kept++] = *here;
        }
    }
    if (n_kept > FOOTSENSE_CORNERS) { /* possible is at most the rectangle around it */
        assume(stages, number, ended(stages, number), stage_time(stages));
        return;
    }
    memcpy(stages->corner, kept, (unsigned)n_kept * sizeof kept[0]);
    stages->n_corners = (uint8_t)n_kept;
}

/* A number of conversions had ended at a time, and the next one had not: narrows the bounds; false if they contradict. */
static bool narrow(footsense_stages *stages, int number, footsense_span at)
{
    int64_t latest = INT64_MIN, earliest = INT64_MAX;
    for (int k = 0; k < stages->n_corners; k++) {
        int64_t ended_at = at_corner(stages, k, number - stages->origin);
        latest = max64(latest, ended_at);
        earliest = min64(earliest, ended_at + stages->corner[k].stage / UNIT);
    }
    if (latest > at.to + NEGLIGIBLE_NS) {
        cut(stages, number, at.to, 1);
    }
    if (earliest < at.from - NEGLIGIBLE_NS) {
        cut(stages, number + 1, at.from, -1);
    }
    return stages->n_corners != 0;
}

/* Nothing is known but when a number of conversions had ended, and the bounds of a stage's time. */
static void begin_anew(footsense_stages *stages, int number, footsense_span at, footsense_span stage)
{
    stages->least = stages->most = number;
    stages->is_known = false;
    for (int slot = 0; slot < SLOTS; slot++) { /* they have numbers of before */
        stages->number[slot] = NONE;
    }
    assume(stages, number, at, stage);
}

/* The least and the most conversions that may have ended at a time. */
static void possible(const footsense_stages *stages, footsense_span at, int *least, int *most)
{
    footsense_span as_many = ended(stages, stages->least), stage = stage_time(stages);
    *least = stages->least + (int)(UNIT * (at.from - as_many.to) / stage.to);
    *most = stages->least + (int)(UNIT * (at.to - as_many.from) / stage.from);
}

void footsense_stages_start(footsense_stages *stages, footsense_span at)
{
    begin_anew(stages, 0, at, ANY_STAGE);
    stages->read = at;
    stages->next = N_UNUSED;
}

void footsense_stages_trust(footsense_stages *stages)
{
    footsense_span at = {stages->read.to - (int64_t)2 * FOOTSENSE_STAGES * FOOTSENSE_LONGEST_STAGE_NS, stages->read.to};
    begin_anew(stages, stages->most, at, stages->n_corners ? stage_time(stages) : ANY_STAGE);
    stages->next = max(stages->next, stages->least + FOOTSENSE_STAGES);
    footsense_stages_miss(stages, at.to);
}

void footsense_stages_miss(footsense_stages *stages, int64_t until)
{
    int least, most;
    stages->read.to = until;
    possible(stages, stages->read, &least, &most);
    stages->most = most;
}

/* Counts what has ended since the last status, as far as this one and the time tell; false if they contradict. */
static bool count(footsense_stages *stages, uint16_t status, footsense_span at)
{
    if (at.from - stages->read.to > (int64_t)PERIOD * FOOTSENSE_LONGEST_STAGE_NS) { /* its clock may have drifted */
        footsense_stages_trust(stages);
    }
    int n = n_stages_of(status), least = stages->least, most = stages->most, least_now = least, most_now = most;
    footsense_span last = stages->read;
    bool was_known = stages->is_known;
    stages->read = at;
    if (n == FOOTSENSE_STAGES || least < most) {
        possible(stages, at, &least_now, &most_now);
    }
    if (n == FOOTSENSE_STAGES) { /* some may have ended more than once */
        least = max(least + n, least_now);
        most = most_now;
    } else {
        if (least < most) {
            least = max(least, least_now - n);
            most = min(most, most_now - n);
        }
        if (n > 0) { /* the first of them was the next at the last status */
            int first = least;
            unsigned row;
            do {
                row = ((1u << n) - 1u) << stage_of(first++);
                if (first > least + FOOTSENSE_STAGES) {
                    return false;
                }
            } while (((row | row >> FOOTSENSE_STAGES) & (unsigned)ALL) != status);
            least = first - 1;
            if (least + FOOTSENSE_STAGES <= most) {
                footsense_span ended_at = {last.from - FOOTSENSE_LONGEST_STAGE_NS, last.to};
                begin_anew(stages, least, ended_at, stage_time(stages));
            }
            most = min(most, least);
            if (!was_known && least == most && !narrow(stages, least, last)) {
                return false;
            }
        } else if (at.from - last.to > FOOTSENSE_LONGEST_STAGE_NS) {
            return false;
        }
        least += n;
        most += n;
    }
    stages->least = least;
    stages->most = most;
    /* Without a bit it may be that of the status before that was lost: the next one tells. */
    stages->is_known = least == most && n > 0;
    return least <= most && (!stages->is_known || narrow(stages, least, at));
}

/* Numbers stay small: they begin anew after a period, and the bounds of a stage's time are a little wider. */
static void renumber(footsense_stages *stages)
{
    int shift = (stages->least - SLOTS) / PERIOD * PERIOD;
    if (shift <= 0) {
        return;
    }
    footsense_span stage = stage_time(stages);
    stage.from -= stage.from / DRIFT_DIVISOR;
    stage.to += stage.to / DRIFT_DIVISOR;
    assume(stages, stages->least, ended(stages, stages->least), stage);
    stages->origin -= shift;
    stages->least -= shift;
    stages->most -= shift;
    stages->next = max(stages->next - shift, FOOTSENSE_STAGES);
    for (int slot = 0; slot < SLOTS; slot++) {
        int32_t number = stages->number[slot];
        stages->number[slot] = number < shift - SLOTS ? NONE : number - shift;
    }
}

footsense_taken footsense_stages_take(footsense_stages *stages, uint16_t before, footsense_span before_at,
                                      const uint16_t code[FOOTSENSE_STAGES], uint16_t behind,
                                      footsense_span behind_at)
{
    if (before >> FOOTSENSE_STAGES) { /* a result is no status; then the one behind it is the first */
        return count(stages, behind, behind_at) ? FOOTSENSE_AGAIN : FOOTSENSE_DOUBT;
    }
    if (!count(stages, before, before_at)) {
        stages->read = behind_at;
        return FOOTSENSE_DOUBT;
    }
    if (!count(stages, behind, behind_at)) {
        return FOOTSENSE_DOUBT;
    }
    /* The status behind the results tells how many had ended before them. */
    int first = stages->most - FOOTSENSE_STAGES, end = stages->least - n_stages_of(behind);
    /* What ended near to a status may be in it or not, and its result new or not. */
    if (behind == 0 && ended(stages, stages->most + 1).from < before_at.to + SKEW_NS) {
        first++;
    }
    if (ended(stages, end).to > before_at.from - SKEW_NS) {
        end--;
    }
    first = max(first, stages->next);
    footsense_span middle = ended(stages, end - FOOTSENSE_STAGES / 2), stage = stage_time(stages);
    if (middle.to - middle.from + FOOTSENSE_STAGES * (stage.to - stage.from) / UNIT <= stage.from / UNIT) {
        for (int number = first; number < end; number++) {
            int slot = number % SLOTS;
            stages->number[slot] = number;
            stages->code[slot] = code[stage_of(number)];
        }
        stages->next = max(stages->next, end);
    }
    renumber(stages);
    return FOOTSENSE_TAKEN;
}

footsense_run footsense_stages_newest(const footsense_stages *stages)
{
    int number = stages->next - FOOTSENSE_STAGES, to_middle = FOOTSENSE_STAGES / 2;
    footsense_span stage = stage_time(stages), middle = ended(stages, number + to_middle);
    footsense_run run = {.step_ns = (int32_t)((stage.from + stage.to) / (2 * UNIT)), .first = (uint8_t)stage_of(number)};
    run.t_ns = (middle.from + middle.to) / 2 + (1 - 2 * to_middle) * run.step_ns / 2;
    for (unsigned k = 0; k < FOOTSENSE_STAGES; k++, number++) {
        int slot = number % SLOTS;
        run.code[k] = stages->code[slot];
        if (stages->number[slot] != number) {
            run.missing = (uint16_t)(run.missing | 1u << k);
        }
    }
    return run;
}
