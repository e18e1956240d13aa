/* The physical limit that the filters are held against: the extended Kalman filter of the 8-state leg, written out by
 * hand for its structure, LANES recordings at a time, one thread.
 *
 * State: x, y, thigh angle, thigh rate, knee angle, knee rate, two gyroscope biases. Compiled twice for each type:
 *   cc -O3 -march=native -ffast-math -shared -fPIC -DREAL=float -DLANES=16 limit.c -lmvec -lm
 * -ffast-math lets the compiler take sine, cosine and logarithm of all lanes at once (libmvec).
 *
 * Only the upper triangle of P is kept. F = I + N is applied in place, as row operations from both sides:
 *   row 0 += a·rows 2..5, row 1 += b·rows 2..5, then row 2 += dt·row 3, row 4 += dt·row 5.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

#ifndef REAL
#define REAL float
#endif
#ifndef LANES
#define LANES 16
#endif

enum { N = 8, M = 2 };
enum { X, Y, THIGH, THIGH_RATE, KNEE, KNEE_RATE, THIGH_BIAS, SHIN_BIAS };

#if LANES == 1
typedef REAL lanes;
#else
typedef REAL lanes __attribute__((vector_size(LANES * sizeof(REAL))));
#endif
typedef REAL array[LANES] __attribute__((aligned(LANES * sizeof(REAL))));

#define LANEWISE(name, function)                              \
    static inline lanes name(lanes v)                         \
    {                                                         \
        array in, out;                                        \
        memcpy(in, &v, sizeof v);                             \
        for (int i = 0; i < LANES; i++) out[i] = function(in[i]); \
        memcpy(&v, out, sizeof v);                            \
        return v;                                             \
    }

#define IS_FLOAT (sizeof(REAL) == sizeof(float))
static inline REAL sine(REAL v) { return IS_FLOAT ? sinf(v) : sin(v); }
static inline REAL cosine(REAL v) { return IS_FLOAT ? cosf(v) : cos(v); }
static inline REAL logarithm(REAL v) { return IS_FLOAT ? logf(v) : log(v); }
LANEWISE(lanes_sin, sine)
LANEWISE(lanes_cos, cosine)
LANEWISE(lanes_log, logarithm)

#define AT(i, j) P[(i) < (j) ? (i) : (j)][(i) < (j) ? (j) : (i)]

/* Row `to` += dt · row `from`, and the same for columns. */
#define ADD_SCALED(to, from)                                                    \
    do {                                                                        \
        lanes before = AT(to, from);                                            \
        for (int j = 0; j < N; j++)                                             \
            if (j != (to)) AT(to, j) += dt * AT(from, j);                       \
        AT(to, to) += dt * (before + AT(to, from));                             \
    } while (0)

/* One tile of LANES recordings. y: (steps, M, LANES), means: (steps, N, LANES), log_likelihood: (LANES). */
static void tile(const REAL *restrict y, REAL *restrict means, REAL *restrict log_likelihood, long steps, REAL dt,
                 REAL thigh, REAL shank, const REAL *start, const REAL *spread, const REAL *q, const REAL *r)
{
    const lanes zero = {0};
    lanes m[N], P[N][N], total = zero;
    for (int i = 0; i < N; i++) {
        m[i] = zero + start[i];
        for (int j = i; j < N; j++) P[i][j] = zero + (i == j ? spread[i] : 0);
    }
    for (long t = 0; t < steps; t++) {
        lanes shin_angle = m[THIGH] + m[KNEE];
        lanes s2 = shank * lanes_sin(shin_angle), c2 = shank * lanes_cos(shin_angle);
        lanes s = thigh * lanes_sin(m[THIGH]) + s2, c = thigh * lanes_cos(m[THIGH]) + c2;
        lanes vx = -s * m[THIGH_RATE] - s2 * m[KNEE_RATE], vy = c * m[THIGH_RATE] + c2 * m[KNEE_RATE];
        lanes rate = m[THIGH_RATE] + m[KNEE_RATE];
        const lanes a[4] = {-dt * vy, -dt * s, -dt * c2 * rate, -dt * s2};
        const lanes b[4] = {dt * vx, dt * c, -dt * s2 * rate, dt * c2};
        m[X] += dt * vx;
        m[Y] += dt * vy;
        m[THIGH] += dt * m[THIGH_RATE];
        m[KNEE] += dt * m[KNEE_RATE];

        lanes x_row[4], y_row[4];
        for (int k = 0; k < 4; k++) x_row[k] = P[X][2 + k], y_row[k] = P[Y][2 + k];
        for (int j = 2; j < N; j++)
            for (int k = 0; k < 4; k++) {
                P[X][j] += a[k] * AT(2 + k, j);
                P[Y][j] += b[k] * AT(2 + k, j);
            }
        for (int k = 0; k < 4; k++) {
            P[X][X] += a[k] * (x_row[k] + P[X][2 + k]);
            P[X][Y] += b[k] * P[X][2 + k] + a[k] * y_row[k];
            P[Y][Y] += b[k] * (y_row[k] + P[Y][2 + k]);
        }
        ADD_SCALED(THIGH, THIGH_RATE);
        ADD_SCALED(KNEE, KNEE_RATE);
        for (int i = 0; i < N; i++) P[i][i] += q[i];

        lanes h0[N], h1[N]; /* P Hᵀ */
        for (int j = 0; j < N; j++) {
            h0[j] = AT(THIGH_RATE, j) + AT(THIGH_BIAS, j);
            h1[j] = AT(THIGH_RATE, j) + AT(KNEE_RATE, j) + AT(SHIN_BIAS, j);
        }
        lanes s00 = h0[THIGH_RATE] + h0[THIGH_BIAS] + r[0];
        lanes s01 = h0[THIGH_RATE] + h0[KNEE_RATE] + h0[SHIN_BIAS];
        lanes s11 = h1[THIGH_RATE] + h1[KNEE_RATE] + h1[SHIN_BIAS] + r[1];
        lanes determinant = s00 * s11 - s01 * s01, inverse = 1 / determinant;
        lanes i00 = s11 * inverse, i01 = -s01 * inverse, i11 = s00 * inverse;
        lanes y0, y1;
        memcpy(&y0, y + (t * M + 0) * LANES, sizeof y0);
        memcpy(&y1, y + (t * M + 1) * LANES, sizeof y1);
        lanes e0 = y0 - m[THIGH_RATE] - m[THIGH_BIAS], e1 = y1 - rate - m[SHIN_BIAS];
        lanes w0 = i00 * e0 + i01 * e1, w1 = i01 * e0 + i11 * e1;
        total += e0 * w0 + e1 * w1 + lanes_log(determinant);
        for (int i = 0; i < N; i++) {
            lanes k0 = h0[i] * i00 + h1[i] * i01, k1 = h0[i] * i01 + h1[i] * i11;
            for (int j = i; j < N; j++) P[i][j] -= k0 * h0[j] + k1 * h1[j];
            m[i] += h0[i] * w0 + h1[i] * w1;
            memcpy(means + (t * N + i) * LANES, &m[i], sizeof m[i]);
        }
    }
    total = (REAL)-0.5 * (total + (REAL)(2 * 1.8378770664093453 * steps)); /* M log 2π a step */
    memcpy(log_likelihood, &total, sizeof total);
}

/* All recordings, `tiles` tiles of LANES one after the other. */
void leg_filter(const REAL *y, REAL *means, REAL *log_likelihood, long tiles, long steps, REAL dt, REAL thigh,
                REAL shank, const REAL *start, const REAL *spread, const REAL *q, const REAL *r)
{
    for (long k = 0; k < tiles; k++)
        tile(y + k * steps * M * LANES, means + k * steps * N * LANES, log_likelihood + k * LANES, steps, dt, thigh,
             shank, start, spread, q, r);
}
