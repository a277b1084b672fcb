/* The CAN frames of footsense as bytes and numbers, for the gait controller. C99, no allocation, no floats.
 *
 * The same frames as ../can, where footsense.dbc has them for other tools; ../vectors tests all of
 * them. footsense_link.h decides whether a stream of frames may be used.
 *
 * Every decoder returns false and leaves *out unchanged unless id, length, crc, counter and codes are valid; an unknown
 * code is invalid.
 */
#ifndef FOOTSENSE_CAN_H
#define FOOTSENSE_CAN_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* CAN ids are these plus the node id of the leg: 1 lf, 2 lm, 3 lr, 4 rf, 5 rm, 6 rr, 7 l4, 8 r4. */
#define FOOTSENSE_FAULT_ID 0x100u
#define FOOTSENSE_FORCE_ID 0x108u
#define FOOTSENSE_COMMAND_ID 0x110u
#define FOOTSENSE_QUALITY_ID 0x118u
#define FOOTSENSE_GAIT_EVENT_ID 0x120u
#define FOOTSENSE_BASELINE_ID 0x128u
#define FOOTSENSE_LEG_MOTION_ID 0x130u
#define FOOTSENSE_GROUND_ID 0x138u
#define FOOTSENSE_ANSWER_ID 0x140u
#define FOOTSENSE_HEARTBEAT_ID 0x148u
#define FOOTSENSE_IDENTITY_ID 0x150u
#define FOOTSENSE_CALIBRATION_ID 0x158u

/* Set these beside the id of a received frame, as linux/can.h does: no such frame is of footsense. */
#define FOOTSENSE_EXTENDED 0x80000000u /* a frame with an id of 29 bits */
#define FOOTSENSE_REMOTE 0x40000000u   /* a remote frame */
#define FOOTSENSE_ERROR 0x20000000u    /* an error frame */

#define FOOTSENSE_PROTOCOL_VERSION 3u /* of the frames that this file reads */

#define FOOTSENSE_LEGS 8u /* that a robot may have */
#define FOOTSENSE_COUNTER_PERIOD 15u /* counters run 0..14 */

/* No value. None of these is ever a measurement. */
#define FOOTSENSE_NO_FORCE INT32_MIN
#define FOOTSENSE_NO_SIGMA UINT16_MAX
#define FOOTSENSE_NO_SIGMA_UN UINT32_MAX
#define FOOTSENSE_NO_MASK UINT16_MAX
#define FOOTSENSE_NO_OFFSET INT32_MIN
#define FOOTSENSE_NO_AGE UINT32_MAX
#define FOOTSENSE_NO_RATIO UINT16_MAX
#define FOOTSENSE_NO_NORMAL INT16_MIN
#define FOOTSENSE_NO_DAY UINT16_MAX
#define FOOTSENSE_NO_ACCELERATION INT16_MIN
#define FOOTSENSE_NO_ACCELERATION_SIGMA UINT32_MAX

/* Command counter of an answer without a command, such as of the tare at start. */
#define FOOTSENSE_UNSOLICITED 15u

enum footsense_state {
    FOOTSENSE_ABSENT = 0,
    FOOTSENSE_VALID = 1,
    FOOTSENSE_NO_BASELINE = 2,
    FOOTSENSE_TARING = 3,
    FOOTSENSE_SATURATED = 4,
    FOOTSENSE_ELEMENT_FAULT = 5,
    FOOTSENSE_CONVERTER_FAULT = 6,
    FOOTSENSE_TOO_OLD = 7, /* `Stale` in the DBC; a link may be stale too, see footsense_link.h */
    FOOTSENSE_OUT_OF_RANGE = 8,
    FOOTSENSE_STOPPED = 9,
    FOOTSENSE_DEGRADED = 10,
    FOOTSENSE_STARTING = 11
};

enum footsense_flag {
    FOOTSENSE_SIMULATED = 1,
    FOOTSENSE_DEGRADED_TIMING = 2,
    FOOTSENSE_TARE_REFUSED = 4,
    FOOTSENSE_CONTACT = 8
};

enum footsense_command { FOOTSENSE_TARE = 1, FOOTSENSE_START = 2, FOOTSENSE_STOP = 3 };

enum footsense_event_kind {
    FOOTSENSE_TOUCHDOWN = 1,
    FOOTSENSE_LIFT_OFF = 2,
    FOOTSENSE_SLIP = 3,    /* the foot begins to slide */
    FOOTSENSE_SLIP_END = 4 /* the foot slides no longer, or carries too little for a slip */
};

enum footsense_phase { FOOTSENSE_PHASE_UNKNOWN = 0, FOOTSENSE_PHASE_SWING = 1, FOOTSENSE_PHASE_STANCE = 2 };

/* How the electrodes of a foot were found. */
enum footsense_calibration_kind {
    FOOTSENSE_CALIBRATION_NONE = 0, /* not: they are taken as designed */
    FOOTSENSE_CALIBRATION_STANDING = 1,
    FOOTSENSE_CALIBRATION_WALKING = 2,
    FOOTSENSE_CALIBRATION_PRESSED = 3
};

/* Result of a command; 0 is done, the others are reasons of a refusal (../can/codes.py, Result). */
enum footsense_result { FOOTSENSE_DONE = 0 };

/* NOT in mN where feet are for more than 32 N: multiply force_mn here, and sigma_un of footsense_quality, by the
 * force_step_mn of the leg's footsense_identity (10 of quadruped-12kg). footsense_link.h does that. */
typedef struct {
    uint8_t node;
    uint8_t counter;
    uint8_t state;       /* enum footsense_state */
    int32_t force_mn[3]; /* ground reaction on the foot, x forward, y left, z up the leg; FOOTSENSE_NO_FORCE */
} footsense_force;

typedef struct {
    uint8_t node;
    uint8_t counter;     /* equal to that of its force */
    uint8_t flags;       /* enum footsense_flag */
    uint32_t sigma_un[3]; /* standard deviation; 55108988: or more; FOOTSENSE_NO_SIGMA_UN; NOT in uN, as above */
    uint16_t contact_permille; /* probability that the foot is on the ground; FOOTSENSE_NO_RATIO */
    uint16_t holds_permille;   /* probability that the foot stands still on the ground; FOOTSENSE_NO_RATIO */
    uint32_t age_us;     /* from the measurement to the send; FOOTSENSE_NO_AGE: unknown, or above 409.4 ms */
} footsense_quality;

typedef struct {
    uint8_t node;
    uint8_t counter;
    uint8_t state;
    uint8_t previous;
    uint8_t cause; /* ../can/codes.py, Cause */
    uint16_t fault_mask; /* bit e: element e is not usable or overloaded; e = 3 row + column */
} footsense_fault; /* on change, and once a second */

typedef struct {
    uint8_t node;
    uint8_t counter;
    uint8_t status;   /* ../can/codes.py, BaselineStatus */
    int32_t mean_af;  /* baseline offset since the last tare, mean of the elements [aF] */
    int32_t worst_af; /* that of the element with the largest [aF]; FOOTSENSE_NO_OFFSET */
    uint32_t age_ms;  /* since it last moved or was tared; 6553400: or more; FOOTSENSE_NO_AGE: no baseline */
} footsense_baseline;

typedef struct {
    uint8_t node;
    uint8_t result; /* FOOTSENSE_DONE, or the reason of a refusal */
    uint8_t counter;
    uint8_t kind;  /* kind of the command */
    uint8_t command_counter; /* counter of the command, or FOOTSENSE_UNSOLICITED */
} footsense_answer;

typedef struct {
    uint8_t node;
    uint8_t state;        /* CANopen NMT state: 0 boot, 4 stopped, 5 operational, 127 pre-operational */
    bool degraded_timing; /* the service runs without the scheduling that it asked for, or a simulation lags */
} footsense_heartbeat;

/* What a consumer needs to read the forces of a leg; sent each second. Every version has this layout. */
typedef struct {
    uint8_t node;
    uint8_t counter;
    uint8_t version;         /* of all frames; FOOTSENSE_PROTOCOL_VERSION, or this file cannot read them */
    uint8_t force_step_mn;   /* what a bit of a force stands for */
    uint32_t foot_type_hash; /* first four bytes of the SHA-256 of the name of the foot type, the first the highest */
} footsense_identity;

typedef struct {
    uint8_t node;
    uint8_t counter;  /* of the leg's events */
    uint8_t kind;     /* enum footsense_event_kind */
    bool all_in_air;  /* every leg of the robot is known to be without contact now */
    uint16_t sigma_us; /* standard deviation of the event's time; 50800: or more; FOOTSENSE_NO_SIGMA */
    uint32_t age_us;  /* from the event to the send; FOOTSENSE_NO_AGE: unknown, or above 6553.4 ms */
} footsense_gait_event;

/* How a foot is calibrated, and how far its force is expected to err; sent each second. */
typedef struct {
    uint8_t node;
    uint8_t counter;
    uint8_t kind;                      /* enum footsense_calibration_kind */
    uint16_t day;                      /* since 2020-01-01; FOOTSENSE_NO_DAY */
    uint16_t size_error_permille;      /* of the size of the force, over it; 1270: or more; FOOTSENSE_NO_RATIO */
    uint16_t direction_error_ddeg;     /* of its direction, 0.1 deg; 254: or more; FOOTSENSE_NO_RATIO */
} footsense_calibration;

/* What a gait controller knows of the motion of a leg, in the frame of the force: x forward, y left, z up the leg. */
typedef struct {
    uint8_t phase;                  /* planned; enum footsense_phase */
    int16_t acceleration_cm_per_s2; /* second derivative of the foot's path along z, gravity not included;
                                       FOOTSENSE_NO_ACCELERATION */
    uint32_t sigma_mm_per_s2;       /* standard deviation of it; FOOTSENSE_NO_ACCELERATION_SIGMA */
    int16_t up_permille[2];         /* unit vector against gravity, x and y; z follows and is positive;
                                       FOOTSENSE_NO_NORMAL */
} footsense_motion;

typedef struct {
    uint8_t node;
    uint8_t counter;
    int16_t normal_permille[2]; /* unit normal into the foot, x forward, y left; z follows from its length of 1 and is
                                   positive; FOOTSENSE_NO_NORMAL */
    uint32_t normal_sigma_urad; /* standard deviation of its direction; 315000: or more; UINT32_MAX: no value */
    uint16_t tangential_over_normal_permille;       /* 2040: or more; FOOTSENSE_NO_RATIO */
    uint16_t tangential_over_normal_sigma_permille; /* standard deviation of it; 248: or more; FOOTSENSE_NO_RATIO */
    uint16_t friction_permille;                     /* coefficient of the ground as configured; FOOTSENSE_NO_RATIO */
} footsense_ground;

/* CRC-8 of AUTOSAR E2E profile 11 variant A: polynomial 0x1D, start 0, over the CAN id and all bytes behind the
 * first of `data`. */
uint8_t footsense_crc8(uint32_t id, const uint8_t *data, uint8_t len);

bool footsense_decode_force(uint32_t id, const uint8_t *data, uint8_t len, footsense_force *out);
bool footsense_decode_quality(uint32_t id, const uint8_t *data, uint8_t len, footsense_quality *out);
bool footsense_decode_fault(uint32_t id, const uint8_t *data, uint8_t len, footsense_fault *out);
bool footsense_decode_baseline(uint32_t id, const uint8_t *data, uint8_t len, footsense_baseline *out);
bool footsense_decode_answer(uint32_t id, const uint8_t *data, uint8_t len, footsense_answer *out);
bool footsense_decode_gait_event(uint32_t id, const uint8_t *data, uint8_t len, footsense_gait_event *out);
bool footsense_decode_ground(uint32_t id, const uint8_t *data, uint8_t len, footsense_ground *out);
bool footsense_decode_identity(uint32_t id, const uint8_t *data, uint8_t len, footsense_identity *out);
bool footsense_decode_calibration(uint32_t id, const uint8_t *data, uint8_t len, footsense_calibration *out);
bool footsense_decode_heartbeat(uint32_t id, const uint8_t *data, uint8_t len, footsense_heartbeat *out);

/* Writes the 8 bytes of a command and returns its CAN id, or 0 if node, counter or kind does not exist. Each
 * command of a leg takes the next counter: the answer repeats it. */
uint16_t footsense_encode_command(uint8_t node, uint8_t counter, uint8_t kind, uint8_t data[8]);

/* Writes the 8 bytes of a leg's motion and returns its CAN id, or 0 if node, counter or phase does not exist, or `up` is
 * longer than 1. Each motion of a leg takes the next counter; after 50 ms without one its motion counts as unknown. */
uint16_t footsense_encode_motion(uint8_t node, uint8_t counter, const footsense_motion *motion, uint8_t data[8]);

#ifdef __cplusplus
}
#endif

#endif
