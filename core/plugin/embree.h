/* SPDX-License-Identifier: Apache-2.0 */
/* Embree 3.13 and 4.x behind one interface. All differences between the two are handled here. */
#ifndef MARRAM_EMBREE_H
#define MARRAM_EMBREE_H

#if defined(__has_include)
#if __has_include(<embree4/rtcore.h>) && !defined(MARRAM_EMBREE3)
#include <embree4/rtcore.h>
#define MARRAM_EMBREE_MAJOR 4
#endif
#endif
#ifndef MARRAM_EMBREE_MAJOR
#include <embree3/rtcore.h>
#define MARRAM_EMBREE_MAJOR 3
#endif

/* Traces one ray in a committed scene. coherent: a hint, nonzero for camera rays. */
static inline void marram_intersect1(RTCScene scene, struct RTCRayHit* rayhit, int coherent) {
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
    rtcIntersect1(scene, rayhit, &args);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    rtcIntersect1(scene, &context, rayhit);
#endif
}

static inline void marram_occluded1(RTCScene scene, struct RTCRay* ray) {
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    rtcOccluded1(scene, ray, &args);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, ray);
#endif
}

/* The same with a filter function that Embree calls for each hit, on any geometry of a scene with the flag
   MARRAM_SCENE_FILTER. It may shorten the ray. marram_query_of(args) returns `query`. */
#if MARRAM_EMBREE_MAJOR == 4
#define MARRAM_SCENE_FILTER RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS
struct MarramFilterContext {
    struct RTCRayQueryContext context; /* first */
    void* query;
};
#else
#define MARRAM_SCENE_FILTER RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION
struct MarramFilterContext {
    struct RTCIntersectContext context; /* first */
    void* query;
};
#endif

/* args: of the filter, or of the callback of a user geometry. */
#define marram_query_of(args) (((struct MarramFilterContext*)(args)->context)->query)

/* From the callbacks of a user geometry: goes on in another scene, with the same filter. For queries of one ray. */
static inline void marram_nested_intersect1(const struct RTCIntersectFunctionNArguments* from, RTCScene scene,
                                            struct RTCRayHit* rayhit) {
#if MARRAM_EMBREE_MAJOR == 4
    rtcForwardIntersect1(from, scene, &rayhit->ray, RTC_INVALID_GEOMETRY_ID);
#else
    rtcIntersect1(scene, from->context, rayhit);
#endif
}

static inline void marram_nested_occluded1(const struct RTCOccludedFunctionNArguments* from, RTCScene scene,
                                           struct RTCRay* ray) {
#if MARRAM_EMBREE_MAJOR == 4
    rtcForwardOccluded1(from, scene, ray, RTC_INVALID_GEOMETRY_ID);
#else
    rtcOccluded1(scene, from->context, ray);
#endif
}

static inline void marram_intersect1_filtered(RTCScene scene, struct RTCRayHit* rayhit, int coherent,
                                              RTCFilterFunctionN filter, void* query) {
    struct MarramFilterContext context;
    context.query = query;
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCIntersectArguments args;
    rtcInitRayQueryContext(&context.context);
    rtcInitIntersectArguments(&args);
    args.flags =
        (enum RTCRayQueryFlags)((coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT) |
                                RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER);
    args.context = &context.context;
    args.filter = filter;
    rtcIntersect1(scene, rayhit, &args);
#else
    rtcInitIntersectContext(&context.context);
    context.context.flags =
        coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    context.context.filter = filter;
    rtcIntersect1(scene, &context.context, rayhit);
#endif
}

static inline void marram_occluded1_filtered(RTCScene scene, struct RTCRay* ray, RTCFilterFunctionN filter,
                                             void* query) {
    struct MarramFilterContext context;
    context.query = query;
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCOccludedArguments args;
    rtcInitRayQueryContext(&context.context);
    rtcInitOccludedArguments(&args);
    args.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
    args.context = &context.context;
    args.filter = filter;
    rtcOccluded1(scene, ray, &args);
#else
    rtcInitIntersectContext(&context.context);
    context.context.filter = filter;
    rtcOccluded1(scene, &context.context, ray);
#endif
}

/* Many rays, `stride` bytes apart. Neighbouring rays from a skin diverge quickly: an incoherent stream takes
   40 % of the time of coherent packets of sixteen. Embree 4 has no streams. */
static inline void marram_occluded_many(RTCScene scene, struct RTCRay* rays, unsigned count, size_t stride) {
#if MARRAM_EMBREE_MAJOR == 4
    for (unsigned i = 0; i < count; ++i) marram_occluded1(scene, (struct RTCRay*)((char*)rays + i * stride));
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    rtcOccluded1M(scene, &context, rays, count, stride);
#endif
}

static inline void marram_intersect_many(RTCScene scene, struct RTCRayHit* rays, unsigned count) {
#if MARRAM_EMBREE_MAJOR == 4
    for (unsigned i = 0; i < count; ++i) marram_intersect1(scene, rays + i, 0);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    rtcIntersect1M(scene, &context, rays, count, sizeof(struct RTCRayHit));
#endif
}

#endif
