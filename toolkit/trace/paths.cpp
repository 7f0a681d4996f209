#include "toolkit/trace/paths.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/trace/exploration.h"

namespace palpate::trace {
namespace {

using geometry::AnalyticSurface;
using geometry::SurfacePoint;

constexpr double kMostFrames = 1e7;  // 2.8 hours at 1 kHz; a gigabyte of trace
// Paths run over the middle 80 % of the surface's parameters.
constexpr double kHalfSpan = 0.4;
// Steps of the surface point agree with the speed to this relative error.
constexpr double kStepAccuracy = 1e-9;
constexpr int kRootSteps = 80;        // halvings suffice for a double
constexpr int kGrowSteps = 200;       // doublings from the first guess to anywhere
constexpr double kFirstGuess = 1e-6;  // of the curve's parameter
// The HIP may move at most this many times as fast as surface point and offset together: never reached on
// smooth surfaces, on an edge, where the normal jumps, it turns the jump into a quick stroke.
constexpr double kFastestHip = 4.0;

struct Common {
  std::size_t frames = 0;
  double rate_hz = 0.0, speed_mm_s = 0.0, depth_mm = 0.0, clearance_mm = 0.0, period_frames = 0.0;
  std::uint64_t seed = 0;
  [[nodiscard]] double step_mm() const { return speed_mm_s / rate_hz; }
  /// From the clearance outside to the depth inside and back, once a period (design section 4).
  [[nodiscard]] double offset_mm(std::size_t k) const {
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / period_frames;
    return 0.5 * (depth_mm + clearance_mm) * std::cos(turn) - 0.5 * (depth_mm - clearance_mm);
  }
  [[nodiscard]] double fastest_offset_mm() const {
    return 0.5 * (depth_mm + clearance_mm) * 2.0 * std::numbers::pi / period_frames;
  }
};

struct Parameters {
  double u = 0.0, v = 0.0;
};
/// A curve over the surface's parameters.
using Curve = std::function<Parameters(double tau)>;

/// The next tau at which the surface point is `step` away from where it is now; negative where there is none.
double advance(const AnalyticSurface& surface, const Curve& curve, double tau, double step, double guess) {
  const auto point = [&](double t) {
    const Parameters at = curve(t);
    return surface.at(at.u, at.v).point_mm;
  };
  const Vec3 from = point(tau);
  const auto excess = [&](double ahead) { return (point(tau + ahead) - from).norm() - step; };
  double low = 0.0, high = guess, at_low = -step, at_high = excess(high);
  for (int i = 0; at_high < 0.0; ++i) {
    if (i == kGrowSteps) return -1.0;
    low = high;
    at_low = at_high;
    high *= 2.0;
    at_high = excess(high);
  }
  // False position with the Illinois rule: an end that stays is given half its weight.
  int stayed = 0;
  for (int i = 0; i < kRootSteps; ++i) {
    const double middle = (low * at_high - high * at_low) / (at_high - at_low);
    const double at_middle = excess(middle);
    if (std::abs(at_middle) <= kStepAccuracy * step) return tau + middle;
    if (at_middle < 0.0) {
      low = middle;
      at_low = at_middle;
      if (stayed == -1) at_high *= 0.5;
      stayed = -1;
    } else {
      high = middle;
      at_high = at_middle;
      if (stayed == 1) at_low *= 0.5;
      stayed = 1;
    }
  }
  return tau + high;
}

/// HIP along the curve at constant surface speed, standing off along the normal. Model frame.
Result<std::vector<Vec3>> follow(const AnalyticSurface& surface, const Curve& curve, const Common& common) {
  std::vector<Vec3> path;
  path.reserve(common.frames);
  const double farthest = kFastestHip * (common.step_mm() + common.fastest_offset_mm());
  double tau = 0.0, guess = kFirstGuess;
  for (std::size_t k = 0; k < common.frames; ++k) {
    const Parameters at = curve(tau);
    const SurfacePoint s = surface.at(at.u, at.v);
    Vec3 hip = s.point_mm + common.offset_mm(k) * s.normal;
    if (k > 0 && (hip - path.back()).norm() > farthest) {
      const Vec3 wish = hip - path.back();
      hip = path.back() + wish * (farthest / wish.norm());
    }
    path.push_back(hip);
    const double next = advance(surface, curve, tau, common.step_mm(), guess);
    if (!(next > tau))
      return Error{"the probe's step in one frame is larger than the model, or vanishes beside it",
                   "choose a speed_mm_s that fits the model's size",
                   {},
                   0};
    // A quarter of the last step: never beyond a nearby turn of the curve.
    guess = 0.25 * (next - tau);
    tau = next;
  }
  return path;
}

/// Back and forth between 0 and 1.
double there_and_back(double x) {
  const double rest = std::fmod(x, 2.0);
  return rest < 1.0 ? rest : 2.0 - rest;
}

Curve weave_curve(std::uint64_t seed) {
  Random random(seed);
  const double phase_u = 2.0 * std::numbers::pi * random.uniform(),
               phase_v = 2.0 * std::numbers::pi * random.uniform();
  return [=](double tau) {
    return Parameters{0.5 + kHalfSpan * std::sin(tau + phase_u),
                      0.5 + kHalfSpan * std::sin(std::numbers::phi * tau + phase_v)};
  };
}

/// Parallel lines joined at their ends; one unit of tau is one line, or one step to the next.
Curve raster_curve(double lines) {
  return [=](double tau) {
    // tau counts lines; a tenth of each unit goes to the next line, then the whole runs back.
    constexpr double kOnLine = 0.9;
    const double along = lines * there_and_back(tau / lines);
    const double line = std::min(std::floor(along), lines - 1.0);
    const double part = along - line;
    const double run = std::min(1.0, part / kOnLine),
                 shift = std::max(0.0, (part - kOnLine) / (1.0 - kOnLine));
    const double u = std::fmod(line, 2.0) == 0.0 ? run : 1.0 - run;
    const double v = lines > 1.0 ? std::min(1.0, (line + shift) / (lines - 1.0)) : 0.5;
    return Parameters{0.5 + kHalfSpan * (2.0 * u - 1.0), 0.5 + kHalfSpan * (2.0 * v - 1.0)};
  };
}

/// In from the rim to the middle and out again; one unit of tau is one turn.
Curve spiral_curve(double turns) {
  return [=](double tau) {
    const double r = kHalfSpan * there_and_back(1.0 + tau / turns), angle = 2.0 * std::numbers::pi * tau;
    return Parameters{0.5 + r * std::cos(angle), 0.5 + r * std::sin(angle)};
  };
}

std::vector<Vec3> tap(const SurfacePoint& at, const Common& common) {
  std::vector<Vec3> path(common.frames);
  for (std::size_t k = 0; k < common.frames; ++k) path[k] = at.point_mm + common.offset_mm(k) * at.normal;
  return path;
}

/// Along the normal to the depth within half a period, then still but for the tremor.
std::vector<Vec3> hold(const SurfacePoint& at, double tremor_mm, const Common& common) {
  constexpr double kTremorHz = 10.0;  // physiological tremor is 8 to 12 Hz
  const auto arrival = static_cast<std::size_t>(0.5 * common.period_frames);
  const Vec3 side = (std::abs(at.normal.x()) < 0.5 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY()))
                        .cross(at.normal)
                        .normalized();
  std::vector<Vec3> path(common.frames);
  for (std::size_t k = 0; k < common.frames; ++k) {
    path[k] = at.point_mm + (k < arrival ? common.offset_mm(k) : -common.depth_mm) * at.normal;
    if (k < arrival || tremor_mm == 0.0) continue;
    const double turn =
        2.0 * std::numbers::pi * kTremorHz * static_cast<double>(k - arrival) / common.rate_hz;
    path[k] += tremor_mm * (std::sin(turn) * at.normal + std::sin(std::numbers::phi * turn) * side);
  }
  return path;
}

/// A rectangle in the plane of the normal and the direction of u: down to the depth, straight on until beyond
/// the box, up to the clearance, back. At constant speed along its sides.
std::vector<Vec3> slide(const AnalyticSurface& surface, double u, double v, const Common& common) {
  constexpr double kDifference = 1e-4;  // of u, for the direction only
  constexpr double kBeyond = 0.1;       // of the box, past its end
  const SurfacePoint start = surface.at(u, v);
  Vec3 along = surface.at(u + kDifference, v).point_mm - surface.at(u - kDifference, v).point_mm;
  along = (along - along.dot(start.normal) * start.normal).normalized();
  const double length = (1.0 - u + kBeyond) * surface.box_mm().extent_mm().maxCoeff();
  const Vec3 high = start.point_mm + common.clearance_mm * start.normal;
  const Vec3 low = start.point_mm - common.depth_mm * start.normal;
  const std::array<Vec3, 5> corners = {high, low, low + length * along, high + length * along, high};
  std::vector<Vec3> path;
  path.reserve(common.frames);
  std::size_t side = 0;
  double done = 0.0;
  while (path.size() < common.frames) {
    const Vec3 whole = corners[side + 1] - corners[side];
    path.push_back(corners[side] + whole * (done / whole.norm()));
    done += common.step_mm();
    while (done >= (corners[side + 1] - corners[side]).norm()) {
      done -= (corners[side + 1] - corners[side]).norm();
      side = (side + 1) % 4;
    }
  }
  return path;
}

std::vector<OptionSpec> with_common(std::vector<OptionSpec> own, bool fixed_speed) {
  std::vector<OptionSpec> specs = {
      {"frames", OptionKind::kInteger, "50000", "number of positions", {}, 1, kMostFrames},
      {"rate_hz", OptionKind::kNumber, "1000", "positions a second", {}, 1e-3, 1e6},
      {"depth_mm", OptionKind::kNumber, "2", "deepest below the surface, mm", {}, 0, 1e150},
      {"clearance_mm", OptionKind::kNumber, "0.4", "highest above the surface, mm", {}, 0, 1e150},
      {"period_frames", OptionKind::kNumber, "900", "frames from one entry to the next", {}, 2, 1e9},
      {"seed", OptionKind::kInteger, "1", "of whatever is chosen by chance", {}, 0, 1e18}};
  if (fixed_speed)
    specs.push_back(
        {"speed_mm_s", OptionKind::kNumber, "50", "speed along the surface, mm/s", {}, 1e-150, 1e150});
  specs.insert(specs.end(), own.begin(), own.end());
  return specs;
}

std::vector<PathGenerator> make_generators() {
  const std::vector<OptionSpec> place = {
      {"u", OptionKind::kNumber, "0.4", "where, 0 to 1 across the model", {}, 0, 1},
      {"v", OptionKind::kNumber, "0.4", "where, 0 to 1 across the model", {}, 0, 1}};
  std::vector<OptionSpec> hold_options = place;
  hold_options.push_back(
      {"tremor_mm", OptionKind::kNumber, "0", "amplitude of a 10 Hz tremor, mm", {}, 0, 1e150});
  std::vector<OptionSpec> slide_options = place;
  slide_options[0].default_value = "0.3";
  return {
      {"weave", "along a Lissajous curve, in and out of the surface", true, with_common({}, true)},
      {"raster", "line by line and back, in and out of the surface", true,
       with_common({{"lines", OptionKind::kInteger, "20", "number of lines", {}, 1, 1e6}}, true)},
      {"spiral", "in from the rim to the middle and out again, in and out of the surface", true,
       with_common({{"turns", OptionKind::kNumber, "10", "turns from the rim to the middle", {}, 0.1, 1e6}},
                   true)},
      {"tap", "in and out along the normal of one place", true, with_common(place, false)},
      {"slide", "straight on at one depth, over the edge, and back outside", true,
       with_common(slide_options, true)},
      {"hold", "down along the normal of one place, then still", true, with_common(hold_options, false)},
      {"exploration", "over any cloud, in and out, with changing speed and direction", false,
       with_common(
           {{"slowest_mm_s", OptionKind::kNumber, "10", "mm/s", {}, 1e-150, 1e150},
            {"fastest_mm_s", OptionKind::kNumber, "50", "mm/s; the HIP never exceeds it", {}, 1e-150, 1e150}},
           false)},
  };
}

Result<std::vector<Vec3>> positions(const std::string& name, const Options& o, const Common& common,
                                    const PathTarget& target) {
  if (name == "exploration") {
    const ExplorationOptions options{
        common.frames,   common.rate_hz,      o.number("slowest_mm_s"), o.number("fastest_mm_s"),
        common.depth_mm, common.clearance_mm, common.period_frames,     common.seed};
    if (options.slowest_mm_s > options.fastest_mm_s)
      return Error{"exploration: slowest_mm_s is more than fastest_mm_s", "exchange them", {}, 0};
    return explore(target, options);
  }
  const AnalyticSurface& surface = *target.surface;
  if (name == "tap") return tap(surface.at(o.number("u"), o.number("v")), common);
  if (name == "hold") return hold(surface.at(o.number("u"), o.number("v")), o.number("tremor_mm"), common);
  if (name == "slide") {
    if (!(common.depth_mm + common.clearance_mm > 0.0))
      return Error{"slide: depth_mm and clearance_mm are both 0", "give one of them", {}, 0};
    return slide(surface, o.number("u"), o.number("v"), common);
  }
  if (name == "raster") return follow(surface, raster_curve(o.number("lines")), common);
  if (name == "spiral") return follow(surface, spiral_curve(o.number("turns")), common);
  return follow(surface, weave_curve(common.seed), common);
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

Result<ProbePath> make_path(const NamedOptions& spec, const PathTarget& target) {
  const PathGenerator* generator = find_path_generator(spec.name);
  if (generator == nullptr) {
    std::string known;
    for (const PathGenerator& g : path_generators()) known += (known.empty() ? "" : ", ") + g.name;
    return Error{fmt::format("there is no path generator '{}'", spec.name), "choose from " + known, {}, 0};
  }
  if (generator->needs_surface && target.surface == nullptr)
    return Error{fmt::format("the path '{}' follows a formula, and this model has none", spec.name),
                 "use 'exploration' or a recorded path",
                 {},
                 0};
  if (!generator->needs_surface && target.cloud == nullptr)
    return Error{fmt::format("the path '{}' needs a cloud", spec.name), "give a model with points", {}, 0};
  Result<Options> complete = validate(spec.options, generator->options, spec.name);
  if (!complete) return std::move(complete).error();
  const Options& o = *complete;
  Common common{static_cast<std::size_t>(o.integer("frames")),
                o.number("rate_hz"),
                o.has("speed_mm_s") ? o.number("speed_mm_s") : 0.0,
                o.number("depth_mm"),
                o.number("clearance_mm"),
                o.number("period_frames"),
                static_cast<std::uint64_t>(o.integer("seed"))};
  Result<std::vector<Vec3>> model_mm = positions(spec.name, o, common, target);
  if (!model_mm) return std::move(model_mm).error();

  ProbePath path;
  path.name = spec.name;
  for (const auto& [key, value] : o.all()) path.name += fmt::format(":{}={}", key, value);
  path.t_s.resize(common.frames);
  path.hip_mm.resize(common.frames);
  for (std::size_t k = 0; k < common.frames; ++k) {
    path.t_s[k] = static_cast<double>(k) / common.rate_hz;
    path.hip_mm[k] = target.world_from_model * (*model_mm)[k];
  }
  if (target.surface != nullptr)
    if (Status free = check_path_starts_free(path, *target.surface, target.world_from_model); !free)
      return free.error();
  return path;
}

Status check_path_starts_free(const ProbePath& path, const AnalyticSurface& surface,
                              const geometry::RigidTransform& world_from_model) {
  if (path.size() == 0) return Error{"the path is empty", "record at least one position", path.name, 0};
  const Vec3 first = world_from_model.inverse() * path.hip_mm.front();
  const double distance = surface.signed_distance_mm(first);
  // On the surface itself, within rounding of the coordinates and the box, counts as outside.
  const double rounding = gamma(64);  // some 64 operations from pose to distance
  const double size = first.norm() + path.hip_mm.front().norm() + surface.box_mm().extent_mm().norm();
  if (distance >= -rounding * size) return Done{};
  return Error{fmt::format("the path starts inside the model, {} mm below its surface", -distance),
               "start in free space", path.name, 2};
}

}  // namespace palpate::trace
