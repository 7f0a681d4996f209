#include <palpate/paths.h>

#include <fmt/format.h>

#include <memory>

#include <palpate/result.h>
#include "toolkit/core/messages.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/paths/hand.h"
#include "toolkit/paths/path_shapes.h"

namespace palpate::paths {
namespace {

using geometry::AnalyticSurface;
using geometry::SurfacePoint;

constexpr double kMaxFrames = 1e7;  // 2.8 hours at 1 kHz; a gigabyte of trace
// Samples along a slide; between two, a surface bending over a tenth of its extent leaves a straight line by
// a millionth of it.
constexpr int kSlidePlaces = 4096;
// Bends below this share of the way are rounding (some thousand operations).
constexpr double kStraight = 1e-12;

/// The HIP along the curve at constant surface speed, offset along the normal. Model frame.
Result<std::vector<Vec3>> follow(const AnalyticSurface& surface, const Curve& curve,
                                 const PathTiming& timing) {
  const auto point = [&](double t) {
    const SurfaceParameters at = curve(t);
    return surface.at(at.u, at.v).point_mm;
  };
  std::vector<Vec3> path;
  path.reserve(timing.frames);
  double tau = 0.0, guess = kFirstGuess;
  for (std::size_t k = 0; k < timing.frames; ++k) {
    const SurfaceParameters at = curve(tau);
    const SurfacePoint s = surface.at(at.u, at.v);
    const Vec3 hip = s.point_mm + timing.offset_mm(k) * s.normal;
    path.push_back(k == 0 ? hip : limit_step(path.back(), hip, timing.farthest_mm()));
    if (timing.step_mm(k) == 0.0) continue;
    const double next = advance(point, tau, timing.step_mm(k), guess);
    if (!(next > tau)) return step_does_not_fit();
    // A quarter of the last step: never beyond a nearby turn of the curve.
    guess = 0.25 * (next - tau);
    tau = next;
  }
  return path;
}

/// Along u at one depth, past the end of the parameters, and back above. On a flat surface the rows are
/// straight lines.
Result<std::vector<Vec3>> slide_along(const AnalyticSurface& surface, double u, double v,
                                      const PathTiming& timing) {
  constexpr double kDifference = 1e-4;  // of u, for the direction only
  const SurfacePoint start = surface.at(u, v);
  Vec3 along = surface.at(u + kDifference, v).point_mm - surface.at(u - kDifference, v).point_mm;
  along = (along - along.dot(start.normal) * start.normal).normalized();
  const double length = (1.0 - u + kSlideOvershoot) * surface.box_mm().extent_mm().maxCoeff();
  std::vector<Vec3> lower, upper;
  bool flat = true;
  for (int i = 0; i <= kSlidePlaces; ++i) {
    const SurfacePoint at = surface.at(u + (1.0 - u + kSlideOvershoot) * i / kSlidePlaces, v);
    const Vec3 way = at.point_mm - start.point_mm;
    flat = flat && (way - way.dot(along) * along).norm() <= kStraight * length &&
           (at.normal - start.normal).norm() <= kStraight;
    lower.push_back(at.point_mm - timing.depth_mm * at.normal);
    upper.push_back(at.point_mm + timing.clearance_mm * at.normal);
  }
  if (flat) {
    lower = {lower.front(), lower.front() + length * along};
    upper = {upper.front(), upper.front() + length * along};
  }
  return slide(lower, upper, timing);
}

/// Options shared by several generators, as flags.
enum Shared : unsigned { kPeriod = 1, kSeed = 2, kSpeed = 4, kFrom = 8, kPlace = 16 };

std::vector<OptionSpec> options_of(unsigned shared, std::vector<OptionSpec> own = {}) {
  std::vector<OptionSpec> specs = {
      option::integer("frames", "50000", "number of positions", 1, kMaxFrames),
      option::number("rate_hz", "1000", "positions a second", 1e-3, 1e6),
      option::number("depth_mm", "2", "deepest below the surface, mm", 0, 1e150),
      option::number("clearance_mm", "0.4", "highest above the surface, mm", 0, 1e150)};
  if ((shared & kPeriod) != 0)
    specs.push_back(option::number("period_frames", "900", "frames from one entry to the next", 2, 1e9));
  if ((shared & kSpeed) != 0)
    specs.push_back(option::number("speed_mm_s", "50", "speed along the surface, mm/s", 1e-150, 1e150));
  if ((shared & kSeed) != 0)
    specs.push_back(option::integer("seed", "1", "of what is chosen by chance", 0, 1e18));
  if ((shared & kPlace) != 0)
    for (const char* key : {"u", "v"})
      specs.push_back(option::number(key, "0.4", "where, 0 to 1 across the model", 0, 1));
  if ((shared & kFrom) != 0)
    specs.push_back(option::choice("from", "auto", "models without a formula: the side they are seen from",
                                   {"auto", "x", "-x", "y", "-y", "z", "-z"}));
  specs.insert(specs.end(), own.begin(), own.end());
  return specs;
}

/// Leaves by 2 mm and more, at speeds from a pressing finger to a knock.
std::vector<OptionSpec> strokes_options() {
  std::vector<OptionSpec> specs = options_of(
      kPeriod | kSeed | kFrom,
      {option::number("slowest_mm_s", "0.1", "mm/s", 1e-150, 1e150),
       option::number("fastest_mm_s", "200", "mm/s; of impacts, and of all that is free", 1e-150, 1e150),
       option::number("impacts", "0.25", "share of the strokes that hit the surface", 0, 1)});
  for (OptionSpec& spec : specs) {
    if (spec.key == "clearance_mm") {
      spec.default_value = "2";
      spec.help = "how far it leaves the surface at least, mm";
      spec.low = 1e-150;
    }
    if (spec.key == "period_frames") spec.help = "frames of a slow stroke";
  }
  return specs;
}

std::vector<OptionSpec> hand_options() {
  return {option::integer("frames", "50000", "number of positions", 1, kMaxFrames),
          option::number("rate_hz", "1000", "positions a second", 1, 1e6),
          option::number("force_n", "0.6", "the hardest press, N", 1e-150, 1e150),
          option::number("slowest_mm_s", "15", "slowest stroke, mm/s", 1e-150, 1e150),
          option::number("fastest_mm_s", "60", "fastest stroke, mm/s", 1e-150, 1e150),
          option::number("bandwidth_hz", "8", "what the arm follows, Hz", 0.1, 1000),
          option::integer("seed", "1", "of what is chosen by chance", 0, 1e18)};
}

std::vector<PathGenerator> make_generators() {
  const std::string follows =
      "any; generated ones by their formula, others by the faces, or else the points, that show from one "
      "side";
  const unsigned curve = kPeriod | kSpeed | kFrom;
  std::vector<OptionSpec> slide_options = options_of(kSpeed | kPlace | kFrom);
  for (OptionSpec& spec : slide_options)
    if (spec.key == "u") spec.default_value = "0.3";
  return {
      {"weave", "along a Lissajous curve, in and out of the surface", follows,
       "weave:frames=20000:depth_mm=1", options_of(curve | kSeed)},
      {"raster", "line by line and back, in and out of the surface", follows, "raster:lines=8:speed_mm_s=100",
       options_of(curve, {option::integer("lines", "20", "number of lines", 1, 1e6)})},
      {"spiral", "in from the rim to the middle and out again, in and out of the surface", follows,
       "spiral:turns=4",
       options_of(curve, {option::number("turns", "10", "turns from the rim to the middle", 0.1, 1e6)})},
      {"strokes", "far off, down at one of many speeds, along the surface, and off again; some hit it",
       follows, "strokes:frames=60000:fastest_mm_s=100", strokes_options()},
      {"tap", "in and out along the normal of one place", follows, "tap:frames=9000:u=0.5:v=0.5",
       options_of(kPeriod | kPlace | kFrom)},
      {"slide", "along the surface at one depth, past its end, and back above it", follows,
       "slide:depth_mm=1:u=0.2", std::move(slide_options)},
      {"hold", "down along the normal of one place in half a period, then still", follows,
       "hold:frames=5000:tremor_mm=0.05",
       options_of(kPeriod | kPlace | kFrom,
                  {option::number("tremor_mm", "0", "amplitude of a 10 Hz tremor, mm", 0, 1e150)})},
      {"hand", "a simulated hand that presses, drags, lifts and taps by what it feels of the model",
       "any; it feels the formula, the faces, or else what the plan takes for the points",
       "hand:frames=20000:seed=7", hand_options()},
      {"exploration",
       "wherever the surface leads, in and out, pushed on where no force would let a hand: see hand",
       "any; only by the points, and by the faces where outside is", "exploration:frames=20000:seed=7",
       options_of(kPeriod | kSeed,
                  {option::number("slowest_mm_s", "10", "mm/s", 1e-150, 1e150),
                   option::number("fastest_mm_s", "50", "mm/s; the HIP never exceeds it", 1e-150, 1e150)})},
  };
}

Curve curve_of(const std::string& name, const Options& o, const PathTiming& timing) {
  if (name == "raster") return raster_curve(o.number("lines"));
  if (name == "spiral") return spiral_curve(o.number("turns"));
  return weave_curve(timing.seed);
}

Status add_strokes(const Options& o, PathTiming& timing) {
  const StrokeOptions options{o.number("slowest_mm_s"), o.number("fastest_mm_s"), o.number("impacts")};
  if (options.slowest_mm_s > options.fastest_mm_s)
    return Error{"strokes: slowest_mm_s is more than fastest_mm_s", "exchange them"};
  timing.speed_mm_s = options.fastest_mm_s;
  timing.frame_steps = strokes(timing, options);
  return Done{};
}

/// HIP positions in the model frame, and additions to the path's name.
struct GeneratedPath {
  std::vector<Vec3> hip_mm;
  std::string remark;
};

Result<GeneratedPath> make_generated(Result<std::vector<Vec3>> path, std::string remark = {}) {
  if (!path) return std::move(path).error();
  return GeneratedPath{*std::move(path), std::move(remark)};
}

Result<GeneratedPath> exploration_path(const Options& o, const PathTiming& timing, const PathTarget& target) {
  const double slowest_mm_s = o.number("slowest_mm_s"), fastest_mm_s = o.number("fastest_mm_s");
  if (slowest_mm_s > fastest_mm_s)
    return Error{"exploration: slowest_mm_s is more than fastest_mm_s", "exchange them"};
  return make_generated(explore(target, timing, slowest_mm_s, fastest_mm_s));
}

Result<GeneratedPath> simulated_hand_path(const Options& o, const PathTarget& target) {
  if (!target.felt || !(target.stiffness_n_per_mm > 0.0))
    return Error{"nothing is there to be felt by a hand", "take another path generator"};
  PALPATE_ASSIGN(const HandOptions options, read_hand_options(o));
  return make_generated(hand_path(target, options));
}

Result<GeneratedPath> over_formula(const std::string& name, const Options& o, const PathTiming& timing,
                                   const AnalyticSurface& surface) {
  if (o.text("from") != "auto")
    return Error{fmt::format("{}: option from does nothing on a model with a formula", name), "leave it out"};
  if (name == "tap") return make_generated(tap(surface.at(o.number("u"), o.number("v")), timing));
  if (name == "hold")
    return make_generated(hold(surface.at(o.number("u"), o.number("v")), o.number("tremor_mm"), timing));
  if (name == "slide") return make_generated(slide_along(surface, o.number("u"), o.number("v"), timing));
  return make_generated(follow(surface, curve_of(name, o, timing), timing));
}

/// Relative to the cloud's origin.
Result<GeneratedPath> at_visible_point(const std::string& name, const Options& o, const PathTiming& timing,
                                       const VisibleSurface& seen) {
  const double u = o.number("u"), v = o.number("v");
  PALPATE_ASSIGN(const VisiblePoint point, nearest_visible(seen, u, v));
  std::string remark;
  if (point.u != u || point.v != v)
    remark = fmt::format(" (at u={:.4g}, v={:.4g}, the nearest place that shows)", point.u, point.v);
  if (name == "tap") return make_generated(tap(point.surface, timing), std::move(remark));
  if (name == "hold")
    return make_generated(hold(point.surface, o.number("tremor_mm"), timing), std::move(remark));
  return make_generated(slide_over(seen, point, timing), std::move(remark));
}

Result<GeneratedPath> over_visible_surface(const std::string& name, const Options& o,
                                           const PathTiming& timing, const PathTarget& target) {
  PALPATE_ASSIGN(const std::unique_ptr<VisibleSurface> seen, make_visible_surface(target, o.text("from")));
  Result<GeneratedPath> path = o.has("u") ? at_visible_point(name, o, timing, *seen)
                                          : make_generated(follow(*seen, curve_of(name, o, timing), timing));
  if (path)
    for (Vec3& p : path->hip_mm) p += target.cloud->origin_mm;
  return path;
}

Result<GeneratedPath> generate_path(const std::string& name, const Options& o, const PathTiming& timing,
                                    const PathTarget& target) {
  if (name == "hand") return simulated_hand_path(o, target);
  if (name == "exploration") return exploration_path(o, timing, target);
  if (name == "slide" && !(timing.depth_mm + timing.clearance_mm > 0.0))
    return Error{"slide: depth_mm and clearance_mm are both 0", "give one of them"};
  return target.surface != nullptr ? over_formula(name, o, timing, *target.surface)
                                   : over_visible_surface(name, o, timing, target);
}

}  // namespace

const std::vector<PathGenerator>& path_generators() {
  static const std::vector<PathGenerator> kAll = make_generators();
  return kAll;
}

const PathGenerator* find_path_generator(std::string_view name) {
  for (const PathGenerator& generator : path_generators())
    if (generator.name == name) return &generator;
  return nullptr;
}

Result<trace::ProbePath> make_path(const NamedOptions& spec, const PathTarget& target) {
  const PathGenerator* generator = find_path_generator(spec.name);
  if (generator == nullptr)
    return Error{fmt::format("there is no path generator '{}'", spec.name),
                 "choose from " + joined(names_of(path_generators()))};
  const bool needs_points = spec.name == "exploration" || spec.name == "hand" || target.surface == nullptr;
  if (needs_points && (target.cloud == nullptr || target.cloud->empty()))
    return Error{fmt::format("the path '{}' needs a cloud", spec.name), "give a model with points"};
  PALPATE_ASSIGN(Options complete, validate(spec.options, generator->options, spec.name));
  const Options& o = complete;
  PathTiming timing{static_cast<std::size_t>(o.integer("frames")),
                    o.number("rate_hz"),
                    o.has("speed_mm_s") ? o.number("speed_mm_s") : 0.0,
                    o.has("depth_mm") ? o.number("depth_mm") : 0.0,
                    o.has("clearance_mm") ? o.number("clearance_mm") : 0.0,
                    o.has("period_frames") ? o.number("period_frames") : 0.0,
                    o.has("seed") ? static_cast<std::uint64_t>(o.integer("seed")) : 0};
  if (spec.name == "strokes") PALPATE_TRY(add_strokes(o, timing));
  PALPATE_ASSIGN(const GeneratedPath model, generate_path(spec.name, o, timing, target));

  trace::ProbePath path;
  path.name = spec.name;
  for (const auto& [key, value] : o.all())
    if (key != "from" || target.surface == nullptr) path.name += fmt::format(":{}={}", key, value);
  path.name += model.remark;
  path.t_s.resize(timing.frames);
  path.hip_mm.resize(timing.frames);
  for (std::size_t k = 0; k < timing.frames; ++k) {
    path.t_s[k] = static_cast<double>(k) / timing.rate_hz;
    path.hip_mm[k] = target.world_from_model * model.hip_mm[k];
  }
  if (target.surface != nullptr)
    PALPATE_TRY(check_path_starts_free(path, *target.surface, target.world_from_model));
  return path;
}

Status check_path_starts_free(const trace::ProbePath& path, const AnalyticSurface& surface,
                              const geometry::RigidTransform& world_from_model) {
  if (path.size() == 0) return Error{"the path is empty", "record at least one position", path.name};
  const Vec3 first = world_from_model.inverse() * path.hip_mm.front();
  const double distance = surface.signed_distance_mm(first);
  // Within rounding, the surface counts as outside.
  const double rounding = gamma(64);  // some 64 operations from pose to distance
  const double size = first.norm() + path.hip_mm.front().norm() + surface.box_mm().extent_mm().norm();
  if (distance >= -rounding * size) return Done{};
  return Error{fmt::format("the path starts inside the model, {} mm below its surface", -distance),
               "start in free space", path.name, 2};
}

}  // namespace palpate::paths
