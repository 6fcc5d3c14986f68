/* luxgraph's interface to Intel Embree 3.13 and 4.x: plain floats and ids, nothing of Embree's own
 * structs, whose layout depends on its version and build flags. Read by bindgen, implemented by embree.c.
 *
 * Contract of every call: pointers are valid for the stated counts; a scene is not changed after
 * lux_scene_new, so the queries may be called on one scene from many threads at once.
 * No call keeps a pointer after it returns, but for what lux_meet is given. Nothing unwinds. */
#ifndef LUXGRAPH_EMBREE_H
#define LUXGRAPH_EMBREE_H

#include <stdint.h>

/* The surfaces, ready for rays. */
typedef struct lux_scene lux_scene;

/* The ray origin + t direction for t in (t_min, t_max), m. Every float must be finite and at most
 * 1.8e18 in magnitude (Embree's limit) (t_max may be infinite) and t_min >= 0; a ray with t_max < t_min is skipped and hits nothing. */
typedef struct lux_ray {
    float origin[3];
    float t_min;
    float direction[3];
    float t_max;
} lux_ray;

/* A part of a surface that is no quad, which the caller tells where rays meet it. */
typedef struct lux_round {
    /* Corners of the box around it. */
    double low[3];
    double high[3];
    /* Number of the surface. */
    uint32_t surface;
    /* Number of the part in it. */
    uint32_t part;
} lux_round;

/* Where a ray meets round number index first within its limits: 1 and the ray parameter in t, or 0. Called from many
 * threads at once. */
typedef uint32_t (*lux_meet)(const void *rounds, uint64_t index, const lux_ray *ray, float *t);

/* Rays in a packet. */
#define LUX_PACKET 16

/* LUX_PACKET rays as above, a column for each of their floats: Embree's own layout, so that nothing is copied. Lies at a
 * multiple of 64 bytes. time and flags are 0, all bits of mask set, and limit repeats t_max. */
typedef struct lux_packet {
    float origin[3][LUX_PACKET];
    float t_min[LUX_PACKET];
    float direction[3][LUX_PACKET];
    float time[LUX_PACKET];
    float t_max[LUX_PACKET];
    uint32_t mask[LUX_PACKET];
    float limit[LUX_PACKET];
    uint32_t flags[LUX_PACKET];
} lux_packet;

/* A packet with room for what Embree finds, again in its own layout: normals, places in the quad, numbers, and what later
 * versions add. Lies at a multiple of 64 bytes; only the rays need to be filled in. */
typedef struct lux_query {
    lux_packet rays;
    float normal[3][LUX_PACKET];
    float u[LUX_PACKET];
    float v[LUX_PACKET];
    uint32_t primitive[LUX_PACKET];
    uint32_t geometry[LUX_PACKET];
    uint32_t instance[LUX_PACKET];
    uint32_t room[2][LUX_PACKET];
} lux_query;

/* Where a ray meets a surface first. */
typedef struct lux_hit {
    /* Ray parameter. */
    float t;
    /* Number of the surface, or LUX_MISS. */
    uint32_t surface;
    /* Of a quad 1 in the triangle v2 v3 v1 and else 0; of what is no quad the number of the part. */
    uint32_t part;
} lux_hit;

/* The same for the rays of a packet, a column for each member. */
typedef struct lux_hits {
    float t[LUX_PACKET];
    uint32_t surface[LUX_PACKET];
    uint32_t part[LUX_PACKET];
} lux_hits;

/* How far beside a quad's box, m, rounding may put a hit: some eight units in the last place of a coordinate of 1. A
 * scene is handed over at a size of about 1. */
#define LUX_ROUNDING 1e-6

/* Square of the sine of the angle between a ray and a quad's plane under which all that Embree says of them may be noise. */
#define LUX_GRAZING2 1e-6

/* So many units in the last place (FLT_EPSILON) of the largest coordinate involved Embree may shift an edge, to first
 * order: the judge's EDGE_ULPS. */
#define LUX_EDGE_ULPS 16.0

/* Room for Embree's message. */
#define LUX_MESSAGE_BYTES 256

/* No surface. */
#define LUX_MISS 0xFFFFFFFFu

/* The version of the library that is loaded as 10000 major + 100 minor + patch (31305 is 3.13.5);
 * 0 if no device can be made. */
uint32_t lux_version(void);

/* A scene of quad_count convex quads, quads[4 i ... 4 i + 3] indexing vertices of three floats each (a triangle
 * repeats its last index), the surface of quad i numbered quad_surface[i]; and of round_count others, which
 * meet, called with meet_rounds, tells apart; meet_rounds must live as long as the scene.
 * Where confirm is not 0, that a quad blocks a ray is confirmed in double precision. Copies everything. On failure
 * returns NULL and writes Embree's reason to message (at least LUX_MESSAGE_BYTES, always terminated). */
lux_scene *lux_scene_new(const float *vertices, uint64_t vertex_count, const uint32_t *quads,
                         const uint32_t *quad_surface, uint64_t quad_count, const lux_round *rounds,
                         uint64_t round_count, lux_meet meet, const void *meet_rounds, int confirm, char *message);

/* Frees a scene; NULL is allowed. */
void lux_scene_free(lux_scene *scene);

/* The closest hit of each of count rays. */
void lux_closest(const lux_scene *scene, const lux_ray *rays, uint64_t count, lux_hit *hits);

/* The closest hit of each ray of count packets. Changes t_max. */
void lux_closest_packets(const lux_scene *scene, lux_query *packets, uint64_t count, lux_hits *hits);

/* Whether anything blocks each of count rays: 1 or 0. */
void lux_occluded(const lux_scene *scene, const lux_ray *rays, uint64_t count, uint8_t *blocked);

/* Whether anything blocks each ray of count packets, one bit each. Changes t_max. */
void lux_occluded_packets(const lux_scene *scene, lux_packet *packets, uint64_t count, uint16_t *blocked);

#endif
