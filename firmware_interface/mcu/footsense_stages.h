/* Which conversion each result of a converter that runs freely is of, and when that was.
 *
 * As footsense/acquisition/boards/stage_tracker.py, which says why; here without floats. The stages of the sequence
 * convert one after the other, without a trigger. The status before a burst of results shows how many have ended; that
 * behind it names those that ended meanwhile, whose results may be torn and are not used. Both bound when the conversions
 * end and how long one takes. */
#ifndef FOOTSENSE_STAGES_H
#define FOOTSENSE_STAGES_H

#include <stdbool.h>
#include <stdint.h>

#define FOOTSENSE_STAGES 9 /* one for each element */
#define FOOTSENSE_STAGE_NS 768000
#define FOOTSENSE_CORNERS 16
#define FOOTSENSE_LONGEST_STAGE_NS 799488 /* its clock is off by 4 % at most, not confirmed; ours by 0.1 % */

/* Something happened on the wire not before `from` and not after `to` [ns]. */
typedef struct {
    int64_t from, to;
} footsense_span;

typedef struct {
    int32_t ended; /* when so many conversions had ended, after a base [ns] */
    int32_t stage; /* time of a stage [ns / 256] */
} footsense_corner;

typedef struct {
    /* Polygon of the times that fit to all that was read: of when a number of conversions, `origin`, had ended, and of a
     * stage. */
    footsense_corner corner[FOOTSENSE_CORNERS];
    int64_t base; /* [ns] */
    int32_t origin;
    uint8_t n_corners;
    bool is_known;       /* the number at the last status is known, and its time has narrowed the polygon */
    int32_t least, most; /* conversions that had ended at the last status */
    footsense_span read; /* when that was read */
    int32_t next;        /* the first that is not stored */
    int32_t number[16];  /* conversion of each code that is stored, at its number modulo 16 */
    uint16_t code[16];
} footsense_stages;

/* The sequence begins with its first stage in a span. */
void footsense_stages_start(footsense_stages *stages, footsense_span at);

/* The chip holds its settings though a status did not fit: the count begins anew with the next one. */
void footsense_stages_trust(footsense_stages *stages);

/* Until a time a status was read, perhaps, and its answer was lost. */
void footsense_stages_miss(footsense_stages *stages, int64_t until);

typedef enum {
    FOOTSENSE_TAKEN,
    FOOTSENSE_AGAIN, /* the burst began one register late (EngineerZone 576116): to be read again at once */
    FOOTSENSE_DOUBT  /* a status does not fit, or the count is lost */
} footsense_taken;

/* Takes a burst: the status read before it, its codes, and the status read behind it. */
footsense_taken footsense_stages_take(footsense_stages *stages, uint16_t before, footsense_span before_at,
                                      const uint16_t code[FOOTSENSE_STAGES], uint16_t behind,
                                      footsense_span behind_at);

/* The newest conversions in a row, one of each stage. */
typedef struct {
    int64_t t_ns;     /* middle of the first one */
    int32_t step_ns;  /* from one to the next */
    uint8_t first;    /* its stage; those of the others follow in turn */
    uint16_t missing; /* bit k: the k-th has no code */
    uint16_t code[FOOTSENSE_STAGES];
} footsense_run;

footsense_run footsense_stages_newest(const footsense_stages *stages);

#endif
