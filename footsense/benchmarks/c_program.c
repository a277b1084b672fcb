/* The floor of `footsense benchmark`: what one cycle of six legs costs where nothing is Python.
 *
 * The same way as the service's, in one call: commands asked for, codes to capacitances to distances, stray and
 * baseline, the last three readings of every element, the elements held against each other, the network, states,
 * protected CAN frames and those that are due now and then to a socket, counters, and a record into a pipe. It is the
 * way of healthy legs: a leg that is not healthy gets its state, and no other way of estimation. Three things it does
 * not do: its zeros do not follow the feet but are those of the service, it does not say which foot is on the ground,
 * and it does not look for calibrations that age. That is arithmetic on a few hundred numbers; no system call is missing.
 * Plain loops that a compiler turns into vector instructions; no library but the C library. Forces are checked against
 * the service's before anything is timed.
 *
 * Compiled when the bench runs, with -DUNITS for the width of the network's hidden layers.
 */
#define _GNU_SOURCE
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { LEGS = 6, ELEMENTS = 9, N = LEGS * ELEMENTS, KEPT = 3, SEEN = 7 * ELEMENTS + 2, OUT = 7, BUCKETS = 16, EVENTS = 4 };

/* ------------------------------------------------------------------ what the foot and the network are */

struct foot {
    double pf_um;              /* capacitance times plate distance [pF um] */
    double gap_um;
    double stray_pf[N], unloaded_pf[N];
    double low_rel[ELEMENTS], high_rel[ELEMENTS];  /* closures that were trained */
    double max_age_ns, longest_ns;                 /* of a reading; between two readings of an element */
    double residual[ELEMENTS][ELEMENTS];           /* of each element, what the others do not predict */
    double limit, limit_rel;                       /* of that: at rest, and over the root of the sum of squares */
};

struct network {
    float w1[SEEN][UNITS], b1[UNITS], w2[UNITS][UNITS], b2[UNITS];
    float out[UNITS][OUT], sigma[UNITS][OUT], sigma_offset[OUT], level[ELEMENTS][3], slope[ELEMENTS][3];
    float soft, period_s, largest, least_s, ln_low, ln_high;
};

static struct foot foot;
static struct network network __attribute__((aligned(64)));

static double rest_rel[N];                       /* plate distance at rest over the gap */
static double kept_rel[KEPT][N];                 /* plate distances over the gap, newest first */
static int64_t kept_ns[KEPT][N];
static int counter;
static double period_s[BUCKETS + 1], age_s[LEGS][BUCKETS + 1], scans, state_scans[LEGS];
static int64_t sent_before_ns, heartbeat_due_ns[LEGS], zero_due_ns[LEGS];
static uint8_t crc_table[256], id_crc[0x800];

static uint8_t crc8(uint8_t crc, const uint8_t *data, int n)
{
    for (int i = 0; i < n; i++) crc = crc_table[crc ^ data[i]];
    return crc;
}

void floor_set(const struct foot *new_foot, const float *weights)
{
    foot = *new_foot;
    memcpy(&network, weights, sizeof network);
    for (int byte = 0; byte < 256; byte++) {
        uint8_t crc = (uint8_t)byte;
        for (int bit = 0; bit < 8; bit++) crc = (uint8_t)(crc << 1 ^ (crc & 0x80 ? 0x1D : 0));
        crc_table[byte] = crc;
    }
    for (int id = 0; id < 0x800; id++) {
        const uint8_t bytes[2] = {(uint8_t)id, (uint8_t)(id >> 8)};
        id_crc[id] = crc8(0, bytes, 2);
    }
}

void floor_tare(const double *baseline_pf)
{
    for (int i = 0; i < N; i++) rest_rel[i] = foot.pf_um / baseline_pf[i] / foot.gap_um;
}

/* ------------------------------------------------------------------ the network */

/* tanh(x) = 1 - 2 / (exp(2 x) + 1), with exp(y) = 2^n exp(r): n in the exponent's bits, r by its series. */
static void tanh_all(float *restrict x, int n)
{
    for (int i = 0; i < n; i++) {
        float y = 2.0f * x[i];
        y = y > 30.0f ? 30.0f : y;
        y = y < -30.0f ? -30.0f : y;
        const float turned = y * 1.44269504f + 12582912.0f; /* rounds: 1.5 * 2^23 */
        union { float f; int32_t i; } whole = {turned}, scale;
        const float r = y - (turned - 12582912.0f) * 0.693147181f;
        const float e = 1.0f + r * (1.0f + r * (0.5f + r * (1.0f / 6 + r * (1.0f / 24 + r * (1.0f / 120)))));
        scale.i = (whole.i << 23) + 0x3F800000; /* the low bits of `turned` are n */
        x[i] = 1.0f - 2.0f / (e * scale.f + 1.0f);
    }
}

static void layer(const float *restrict in, int n_in, const float *restrict w, const float *restrict b, float *restrict out)
{
    for (int leg = 0; leg < LEGS; leg++) memcpy(out + leg * UNITS, b, sizeof(float) * UNITS);
    /* Three legs at a time share each weight that is loaded. */
    for (int leg = 0; leg < LEGS; leg += 3) {
        float *restrict o0 = out + leg * UNITS, *restrict o1 = o0 + UNITS, *restrict o2 = o1 + UNITS;
        for (int k = 0; k < n_in; k++) {
            const float *restrict wk = w + k * UNITS;
            const float a0 = in[leg * n_in + k], a1 = in[(leg + 1) * n_in + k], a2 = in[(leg + 2) * n_in + k];
            for (int u = 0; u < UNITS; u++) {
                o0[u] += a0 * wk[u];
                o1[u] += a1 * wk[u];
                o2[u] += a2 * wk[u];
            }
        }
    }
    tanh_all(out, LEGS * UNITS);
}

static float clipped(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

/* Forces and contacts, of closures and ages of the last readings, newest first; the inputs as in windowed_network.py. */
static void estimate(const float closure_rel[LEGS][KEPT][ELEMENTS], const float age_s[LEGS][KEPT][ELEMENTS],
                     float force_n[LEGS][3], float sigma_n[LEGS][3])
{
    static float seen[LEGS * SEEN], first[LEGS * UNITS], second[LEGS * UNITS], now_rel[LEGS][ELEMENTS];
    float size[LEGS];
    for (int leg = 0; leg < LEGS; leg++) {
        const float(*v)[ELEMENTS] = closure_rel[leg], (*a)[ELEMENTS] = age_s[leg];
        float *planes = seen + leg * SEEN, d1[ELEMENTS], d2[ELEMENTS], age[ELEMENTS], period_s = 0, sum = 0;
        for (int e = 0; e < ELEMENTS; e++) period_s += fmaxf(a[1][e] - a[0][e], network.least_s) / ELEMENTS;
        for (int e = 0; e < ELEMENTS; e++) {
            d1[e] = (v[0][e] - v[1][e]) * period_s / fmaxf(a[1][e] - a[0][e], network.least_s);
            d2[e] = d1[e] - (v[1][e] - v[2][e]) * period_s / fmaxf(a[2][e] - a[1][e], network.least_s);
            age[e] = a[0][e] / period_s;
            now_rel[leg][e] = v[0][e] + age[e] * d1[e];
            sum += v[0][e] * v[0][e] + now_rel[leg][e] * now_rel[leg][e];
        }
        size[leg] = sqrtf(sum / (2 * ELEMENTS) + network.soft);
        for (int e = 0; e < ELEMENTS; e++) {
            const float plane[6] = {v[0][e], d1[e], age[e] * d1[e], d2[e], age[e] * d2[e], age[e] * age[e] * d2[e]};
            for (int k = 0; k < 6; k++)
                planes[k * ELEMENTS + e] = clipped(plane[k] / size[leg], -network.largest, network.largest);
        }
        planes[SEEN - 2] = size[leg]; /* before it, nothing is missing: zeros */
        planes[SEEN - 1] = logf(period_s / network.period_s);
    }
    layer(seen, SEEN, &network.w1[0][0], network.b1, first);
    layer(first, UNITS, &network.w2[0][0], network.b2, second);
    for (int leg = 0; leg < LEGS; leg++) {
        float out[OUT] = {0}, ln_sigma[OUT] = {0}, square = 0;
        for (int u = 0; u < UNITS; u++)
            for (int k = 0; k < OUT; k++) {
                out[k] += second[leg * UNITS + u] * network.out[u][k];
                ln_sigma[k] += second[leg * UNITS + u] * network.sigma[u][k];
            }
        for (int e = 0; e < ELEMENTS; e++) square += now_rel[leg][e] * now_rel[leg][e] / ELEMENTS;
        for (int axis = 0; axis < 3; axis++) {
            float straight = 0;
            for (int e = 0; e < ELEMENTS; e++)
                straight += now_rel[leg][e] * network.level[e][axis]
                    + (now_rel[leg][e] - closure_rel[leg][0][e]) * network.slope[e][axis];
            force_n[leg][axis] = straight + square / size[leg] * out[axis];
            sigma_n[leg][axis] =
                size[leg] * expf(clipped(ln_sigma[axis] + network.sigma_offset[axis], network.ln_low, network.ln_high));
        }
    }
}

/* Whether no element of a leg contradicts the others. */
static int agree(const double *closure_rel, double motion_rel)
{
    double sum = 0;
    int good = 1;
    for (int e = 0; e < ELEMENTS; e++) sum += closure_rel[e] * closure_rel[e];
    const double limit = foot.limit + motion_rel + foot.limit_rel * sqrt(sum);
    for (int e = 0; e < ELEMENTS; e++) {
        double residual = 0;
        for (int k = 0; k < ELEMENTS; k++) residual += foot.residual[e][k] * closure_rel[k];
        good &= fabs(residual) <= limit;
    }
    return good;
}

/* ------------------------------------------------------------------ out */

struct frame { uint32_t id; uint8_t length, reserved[3], data[8]; }; /* struct can_frame */

static void protect(struct frame *frame, uint32_t id, uint64_t payload)
{
    frame->id = id;
    frame->length = 8;
    for (int i = 1; i < 8; i++) frame->data[i] = (uint8_t)(payload >> 8 * (i - 1));
    frame->data[0] = crc8(id_crc[id], frame->data + 1, 7);
}

static uint64_t milli(double force_n)
{
    return (uint16_t)(int16_t)lrint(fmax(-32767, fmin(32767, force_n * 1000)));
}

static uint64_t sigma_code(double sigma_n) { return sigma_n < 1.02 ? (uint64_t)(sigma_n * 500 + (1 - 1e-6)) : 510; }

/* Whether something is due that comes every `period_ns`, each leg at its own time. */
static int is_due(int64_t *due_ns, int64_t period_ns, int leg, int64_t now_ns)
{
    if (!*due_ns) *due_ns = now_ns + period_ns * leg / LEGS;
    if (now_ns < *due_ns) return 0;
    *due_ns += (1 + (now_ns - *due_ns) / period_ns) * period_ns;
    return 1;
}

/* Put the heartbeats and zeros that are due behind the forces, as many as there is room for. */
static int add_events(struct frame *frames, int64_t now_ns)
{
    int n = 0;
    for (int leg = 0; leg < LEGS && n < EVENTS; leg++) {
        if (is_due(&heartbeat_due_ns[leg], 200000000, leg, now_ns))
            frames[n++] = (struct frame){.id = 0x701 + (uint32_t)leg, .length = 1, .data = {5}};
        if (n < EVENTS && is_due(&zero_due_ns[leg], 1000000000, leg, now_ns))
            protect(&frames[n++], 0x381 + (uint32_t)leg, (uint64_t)counter);
    }
    return n;
}

static void count(double *histogram, double seconds)
{
    int bucket = 0;
    for (double bound = 1e-3; bucket < BUCKETS - 1 && seconds > bound; bound *= 1.5) bucket++;
    histogram[bucket] += 1;
    histogram[BUCKETS] += seconds;
}

struct record {
    uint32_t length;
    uint16_t n_commands, n_outcomes;
    uint64_t kind, counter;
    int64_t sequence, force_sequence, sent_ns, scan_t_ns[N];
    double capacitance_pf[N];
    int64_t force_t_ns[LEGS];
    double force_n[LEGS][3], sigma_n[LEGS][3], baseline_mean_pf[LEGS], baseline_worst_pf[LEGS];
    int64_t baseline_moved_ns[LEGS];
    uint16_t fault_mask[LEGS];
    uint8_t reading[N], state[LEGS], flags[LEGS], cause[LEGS], baseline_status[LEGS];
};

/* One cycle; returns 0, or -1 without a record. `force_n` gets shape (legs, 3). */
int floor_cycle(const int32_t *code, const int64_t *t_ns, int64_t now_ns, int socket, int pipe, double *force_n)
{
    static struct record record = {.length = sizeof record, .kind = 1};
    float closures_rel[LEGS][KEPT][ELEMENTS], ages_s[LEGS][KEPT][ELEMENTS], forces_n[LEGS][3], sigmas_n[LEGS][3];
    struct frame frames[2 * LEGS + EVENTS];

    while (recv(socket, frames, sizeof frames[0], MSG_DONTWAIT) > 0) {} /* commands: none comes */

    for (int leg = 0; leg < LEGS; leg++) {
        int64_t newest_ns = 0, oldest_ns = INT64_MAX;
        double newest_rel[ELEMENTS], most_rel = 0, motion_rel = 0; /* the largest change, the second largest */
        int good = 1;
        for (int e = 0; e < ELEMENTS; e++) {
            const int i = leg * ELEMENTS + e;
            const double pf = code[i] * (1.0 / (1 << 19)) - foot.stray_pf[i];
            if (t_ns[i] != kept_ns[0][i])
                for (int k = KEPT - 1; k > 0; k--) {
                    kept_rel[k][i] = kept_rel[k - 1][i];
                    kept_ns[k][i] = kept_ns[k - 1][i];
                }
            kept_rel[0][i] = foot.pf_um / pf / foot.gap_um;
            kept_ns[0][i] = t_ns[i];
            newest_ns = t_ns[i] > newest_ns ? t_ns[i] : newest_ns;
            oldest_ns = t_ns[i] < oldest_ns ? t_ns[i] : oldest_ns;
            double moved_rel = 0;
            for (int k = 1; k < KEPT; k++) {
                const int64_t between_ns = kept_ns[k - 1][i] - kept_ns[k][i];
                good &= between_ns > 0 && (double)between_ns <= foot.longest_ns;
                moved_rel = fmax(moved_rel, fabs(kept_rel[k - 1][i] - kept_rel[k][i]));
            }
            motion_rel = fmax(motion_rel, fmin(most_rel, moved_rel));
            most_rel = fmax(most_rel, moved_rel);
            for (int k = 0; k < KEPT; k++) {
                closures_rel[leg][k][e] = (float)(rest_rel[i] - kept_rel[k][i]);
                ages_s[leg][k][e] = (float)((double)(now_ns - kept_ns[k][i]) * 1e-9);
            }
            newest_rel[e] = rest_rel[i] - kept_rel[0][i];
            good &= pf >= 0.5 * foot.unloaded_pf[i] && newest_rel[e] <= 0.95;
            good &= newest_rel[e] >= foot.low_rel[e] && newest_rel[e] <= foot.high_rel[e];
            record.capacitance_pf[i] = pf + foot.stray_pf[i];
            record.scan_t_ns[i] = t_ns[i];
        }
        good &= agree(newest_rel, motion_rel) && (double)(now_ns - oldest_ns) <= foot.max_age_ns;
        record.force_t_ns[leg] = newest_ns;
        record.state[leg] = good ? 1 : 10;
    }
    estimate(closures_rel, ages_s, forces_n, sigmas_n);

    struct iovec parts[2 * LEGS + EVENTS];
    struct mmsghdr messages[2 * LEGS + EVENTS];
    memset(messages, 0, sizeof messages);
    counter = (counter + 1) % 15;
    for (int leg = 0; leg < LEGS; leg++) {
        const float *f = forces_n[leg], *sigma = sigmas_n[leg];
        for (int axis = 0; axis < 3; axis++) {
            force_n[leg * 3 + axis] = record.force_n[leg][axis] = f[axis];
            record.sigma_n[leg][axis] = sigma[axis];
        }
        const int64_t age_ns = now_ns - record.force_t_ns[leg];
        protect(&frames[2 * leg], 0x181 + (uint32_t)leg,
                (uint64_t)(record.state[leg] << 4 | counter) | milli(f[0]) << 8 | milli(f[1]) << 24 | milli(f[2]) << 40);
        protect(&frames[2 * leg + 1], 0x281 + (uint32_t)leg,
                (uint64_t)counter | 1 << 4 | (uint64_t)((age_ns + 99999) / 100000) << 8 | sigma_code(sigma[0]) << 29
                    | sigma_code(sigma[1]) << 38 | sigma_code(sigma[2]) << 47);
        count(age_s[leg], (double)age_ns * 1e-9);
        state_scans[leg] += 1;
    }
    const int n_frames = 2 * LEGS + add_events(frames + 2 * LEGS, now_ns);
    for (int i = 0; i < n_frames; i++) {
        parts[i] = (struct iovec){&frames[i], sizeof frames[i]};
        messages[i].msg_hdr.msg_iov = &parts[i];
        messages[i].msg_hdr.msg_iovlen = 1;
    }
    sendmmsg(socket, messages, (unsigned)n_frames, MSG_DONTWAIT);

    if (sent_before_ns) count(period_s, (double)(now_ns - sent_before_ns) * 1e-9);
    sent_before_ns = now_ns;
    scans += 1;
    record.counter++;
    record.sequence = record.force_sequence++;
    record.sent_ns = now_ns;
    return write(pipe, &record, sizeof record) < 0 ? -1 : 0;
}

/* ------------------------------------------------------------------ in time */

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

/* Sleep to `n` deadlines and do a cycle after each, of scans that are played round and round, each round `round_ns`
 * later than the one before; how late each cycle began goes to `late_ns`. */
void floor_pace(int64_t period_ns, int n, const int32_t *codes, const int64_t *t_ns, const int64_t *now_ns, int n_scans,
                int64_t round_ns, int socket, int sink, int pipe, int drain, int64_t *late_ns)
{
    static int64_t later_ns = 0;
    char swallowed[1 << 16];
    double force_n[LEGS * 3];
    int64_t shifted_ns[N], deadline_ns = now();
    for (int i = 0; i < n; i++) {
        const int scan = i % n_scans;
        if (scan == 0) later_ns += round_ns;
        for (int k = 0; k < N; k++) shifted_ns[k] = t_ns[scan * N + k] + later_ns;
        const int64_t start_ns = now();
        do deadline_ns += period_ns;
        while (deadline_ns <= start_ns);
        const struct timespec deadline = {deadline_ns / 1000000000, deadline_ns % 1000000000};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL)) {}
        late_ns[i] = now() - deadline_ns;
        floor_cycle(codes + scan * N, shifted_ns, now_ns[scan] + later_ns, socket, pipe, force_n);
        while (recv(sink, swallowed, sizeof swallowed, MSG_DONTWAIT) > 0) {}
        if (read(drain, swallowed, sizeof swallowed) < 0) continue;
    }
}
