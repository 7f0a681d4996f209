// The one place that knows which Embree is installed: 3.x names its per-query argument an intersect
// context, 4.x passes arguments. Include in .cpp files alone.
#pragma once

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace palpate::baselines::shim {

#if RTC_VERSION_MAJOR >= 4
using Context = RTCRayQueryContext;
inline constexpr RTCSceneFlags kFilterFlag = RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS;
inline void init(Context& context) noexcept {
  rtcInitRayQueryContext(&context);
}
inline void intersect(RTCScene scene, Context& context, RTCFilterFunctionN filter, RTCRayHit& ray) noexcept {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.context = &context;
  arguments.filter = filter;
  rtcIntersect1(scene, &ray, &arguments);
}
#else
using Context = RTCIntersectContext;
inline constexpr RTCSceneFlags kFilterFlag = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;
inline void init(Context& context) noexcept {
  rtcInitIntersectContext(&context);
}
inline void intersect(RTCScene scene, Context& context, RTCFilterFunctionN filter, RTCRayHit& ray) noexcept {
  context.filter = filter;
  rtcIntersect1(scene, &context, &ray);
}
#endif

}  // namespace palpate::baselines::shim
