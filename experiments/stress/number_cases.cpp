// Scale, offset, number of points, threads.
#include <fmt/format.h>

#include <palpate/result.h>
#include "experiments/stress/setups.h"

namespace palpate::experiments {
namespace {

// Points off the grid: for a square's four points rounding alone would choose the diagonal.
constexpr const char* kWave =
    "sinusoid:extent_mm=30:amplitude_mm=1:wavelength_mm=20:spacing_mm=0.5:jitter=0.3";
constexpr const char* kStone = "pebble:extent_mm=20:points=6000:finest=0.6:slope=0.1:jitter=0.3";

using Unit = std::shared_ptr<const StressSetup>;

Result<Unit> unit_of(const char* generator) {
  PALPATE_ASSIGN(StressSetup setup, setup_of_generator(generator));
  // Stored about the points' centre, like the twins: generators store about the formula's box, and a shifted
  // voxel lattice interpolates differently.
  render::ModelInput& model = setup.scene.models.front();
  std::vector<Vec3> points(model.cloud->size());
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = model.cloud->point_mm(i);
  PALPATE_ASSIGN(cloud::Cloud stored, cloud::build_cloud(points, cloud::NonFinite::kRefuse));
  stored.raster = model.cloud->raster;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(stored));
  weave(setup, 5.0, 0.8, 3.0, 0.2, 600);
  return Unit(std::make_shared<const StressSetup>(std::move(setup)));
}

/// A slope on a grid as a height field: both diagonals of a square give the same surface.
Result<Unit> slope() {
  constexpr int kHalf = 25;
  constexpr double kStep = 0.5, kAlongX = 0.21, kAlongY = -0.13;
  std::vector<Vec3> points;
  for (int j = -kHalf; j <= kHalf; ++j)
    for (int i = -kHalf; i <= kHalf; ++i)
      points.emplace_back(kStep * i, kStep * j, kStep * (kAlongX * i + kAlongY * j));
  PALPATE_ASSIGN(StressSetup setup, setup_of_points(points, "slope"));
  dip(setup, {.from = {-3.1, 2.2, 0},
              .to = {2.7, -1.3, 0},
              .out_mm = 6.0,
              .deep_mm = 2.0,
              .clear_mm = 5.0,
              .felt_mm = 1.5,
              .frames = 150});
  return Unit(std::make_shared<const StressSetup>(std::move(setup)));
}
MakeSetup slope_by(const Stretch& by) {
  return [by]() -> Result<StressSetup> {
    PALPATE_ASSIGN(const Unit unit, slope());
    return stretched(unit, by);
  };
}

MakeSetup stretched_by(const char* generator, const Stretch& by) {
  return [generator, by]() -> Result<StressSetup> {
    PALPATE_ASSIGN(const Unit unit, unit_of(generator));
    return stretched(unit, by);
  };
}

void add_scales(CaseGroup scales) {
  struct Scale {
    const char* name;
    double factor;
    const char* text;
    bool quick;
  };
  for (const Scale& s : {Scale{"scale-unit", 1.0, "A wave at unit scale, the twin of the others.", true},
                         {"scale-2^-20", 0x1p-20, "A millionth, as a power of two: exact.", true},
                         {"scale-2^20", 0x1p20, "A million times, as a power of two: exact.", true},
                         {"scale-1e-6", 1e-6, "A millionth: every coordinate is rounded anew.", true},
                         {"scale-1e-3", 1e-3, "A thousandth.", false},
                         {"scale-1e3", 1e3, "A thousand times.", false},
                         {"scale-1e6", 1e6, "A million times: a wave of 30 km.", true}})
    scales.add(s.name, s.text, stretched_by(kWave, {s.factor, Vec3::Zero(), {}}), s.quick);
  scales.add("scale-closed-2^-20", "A closed pebble at a millionth, as a power of two.",
             stretched_by(kStone, {0x1p-20, Vec3::Zero(), {}}));
  scales.add("scale-closed-1e6", "A closed pebble a million times as large.",
             stretched_by(kStone, {1e6, Vec3::Zero(), {}}));
  scales.quick("scale-slope-2^-20", "A slope on a grid at a millionth, as a power of two.",
               slope_by({0x1p-20, Vec3::Zero(), {}}));
  scales.quick("scale-slope-1e6", "A slope on a grid a million times as large.",
               slope_by({1e6, Vec3::Zero(), {}}));
  scales.quick("scale-denormal", "All coordinates below the normal numbers of single precision.",
               []() -> Result<StressSetup> {
                 PALPATE_ASSIGN(const Unit wave, unit_of(kWave));
                 auto unit = std::make_shared<StressSetup>(*wave);
                 unit->scene.models.front().analytic = nullptr;  // no generator has this scale
                 PALPATE_ASSIGN(StressSetup setup, stretched(unit, {0x1p-140, Vec3::Zero(), {}}));
                 setup.twin = nullptr;  // the points themselves lose digits
                 let_nothing_be_due(setup);
                 return setup;
               });
}

void add_offsets(CaseGroup offsets) {
  struct Offset {
    const char *name, *text;
    double mm;
    bool quick;
  };
  for (const Offset& o : {Offset{"1e3", "a metre", 1e3, false},
                          {"1e4", "ten metres", 1e4, false},
                          {"1e5", "a hundred metres", 1e5, false},
                          {"1e6", "a kilometre", 1e6, true},
                          {"1e9", "a thousand kilometres", 1e9, true}}) {
    const Vec3 by = o.mm * Vec3(1.0, -0.7, 0.4);
    offsets.add(fmt::format("offset-{}", o.name),
                fmt::format("The points {} from the origin of their file.", o.text),
                stretched_by(kWave, {1.0, by, {}}), o.quick);
    geometry::RigidTransform pose;
    pose.translation_mm = by;
    offsets.add(fmt::format("placed-{}", o.name),
                fmt::format("The model placed {} from the origin of the world.", o.text),
                stretched_by(kWave, {1.0, Vec3::Zero(), pose}));
  }
  offsets.quick("offset-slope-1e9", "A slope on a grid a thousand kilometres from the origin of its file.",
                slope_by({1.0, 1e9 * Vec3(1.0, -0.7, 0.4), {}}));
  geometry::RigidTransform turned;
  turned.translation_mm = 1e9 * Vec3(-0.3, 1.0, 0.2);
  turned.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(1.1, Vec3(1, 2, 3).normalized()));
  offsets.add("turned-1e9", "Placed a thousand kilometres away and turned.",
              [turned]() -> Result<StressSetup> {
                PALPATE_ASSIGN(StressSetup setup, stretched_by(kStone, {1.0, Vec3::Zero(), turned})());
                setup.twin = nullptr;  // the forces are rotated
                return setup;
              });
  offsets.quick("offset-closed-1e9", "A closed pebble a thousand kilometres from the origin of its file.",
                stretched_by(kStone, {1.0, 1e9 * Vec3(0.5, 1.0, -0.25), {}}));
}

void add_points(CaseGroup points) {
  const Change woven = [](StressSetup& setup) { weave(setup, 3.0, 1.0, 1.5, 0.2, 1000); };
  points.add("points-10k", "10,201 points of table 7's surface.", on("sinusoid:points=10201", woven));
  points.add("points-1m", "A million points.", on("sinusoid:points=1002001", woven));
  points.add("points-10m", "Ten million points.", on("sinusoid:points=10004569", woven), false, true);
  points.quick("threads", "Prepared with four threads, against one: the same bits.",
               []() -> Result<StressSetup> {
                 PALPATE_ASSIGN(const Unit unit, unit_of(kStone));
                 StressSetup setup = *unit;
                 setup.threads = 4;
                 setup.twin = unit;
                 return setup;
               });
}

}  // namespace

void add_number_cases(std::vector<StressCase>& cases) {
  add_scales({cases, "scale"});
  add_offsets({cases, "offset"});
  add_points({cases, "points"});
}

}  // namespace palpate::experiments
