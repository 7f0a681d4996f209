// Extreme probe motions, surfaces and HIPs.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include <palpate/result.h>
#include "experiments/stress/setups.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

constexpr const char* kFlat = "plane:extent_mm=20:spacing_mm=0.5";
constexpr const char* kBall = "sphere:extent_mm=20:points=5000";
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNoNumberAtAll = std::numeric_limits<double>::quiet_NaN();
constexpr double kTiny = std::numeric_limits<double>::denorm_min();

/// A wave at hand speed with one change.
MakeSetup waved(Change change) {
  return on("sinusoid:extent_mm=30:amplitude_mm=1:wavelength_mm=20:spacing_mm=0.5", [=](StressSetup& setup) {
    weave(setup, 5.0, 0.8, 3.0, 0.2, 400);
    change(setup);
  });
}

Change ticks(double dt_s, double start_s = 0.0) {
  return [=](StressSetup& setup) {
    for (std::size_t i = 0; i < setup.path.size(); ++i)
      setup.path.t_s[i] = start_s + dt_s * static_cast<double>(i);
  };
}

void add_speeds(CaseGroup speeds) {
  speeds.add("speed-0", "At rest half a millimetre deep for 300 frames.",
             on(kFlat, along({0.13, 0.21, 5}, [](Way& way) {
                  way.to({0.13, 0.21, 3}, 20, Due::kFree).to({0.13, 0.21, -0.5}, 60, Due::kAny);
                  way.stay(300, Due::kInside).to({0.13, 0.21, 3}, 60, Due::kAny);
                  way.to({0.13, 0.21, 5}, 20, Due::kFree);
                })));
  for (const double speed : {0.1, 1.0, 10.0})  // m/s, equal to mm per 1 ms frame
    speeds.add(fmt::format("speed-{:g}", speed),
               fmt::format("Into a ball and out again at {:g} m/s, and across its middle.", speed),
               on(kBall, along({0.3, 0.2, 40},
                               [speed](Way& way) {
                                 // Deep frames that began outside are due; across, either side may hold.
                                 const auto steps = [speed](double mm) {
                                   return std::max(2, static_cast<int>(mm / speed));
                                 };
                                 way.to({0.3, 0.2, 16}, steps(24), Due::kFree);
                                 way.to({0.3, 0.2, 5}, steps(11), [](const Vec3& p) {
                                   return p.norm() < 9.5 ? Due::kInside : Due::kAny;
                                 });
                                 way.to({0.3, 0.2, 16}, steps(11), Due::kAny);
                                 way.to({0.3, 0.2, 40}, steps(24), Due::kFree);
                                 way.to({0.3, 0.2, -40}, steps(80), Due::kAny);
                                 way.to({35, 0, -20}, steps(40), Due::kAny);
                                 way.to({0.3, 0.2, 40}, steps(70), Due::kAny).stay(5, Due::kFree);
                               })),
               speed == 10.0);
  speeds.quick("teleport", "A place anywhere within ten models in every frame.",
               on(kBall, along({0, 0, 50}, [](Way& way) {
                    Random random(7);
                    const auto length = [&] { return random.uniform(-100.0, 100.0); };
                    for (int i = 0; i < 1000; ++i) way.jump(Vec3{length(), length(), length()}, Due::kAny);
                    way.jump({0, 0, 50}, Due::kAny).stay(3, Due::kAny);
                  })));
}

void add_depths(CaseGroup depths) {
  depths.quick("depth-ulp", "One rounding unit below, on and above the surface, at 1,000 places.",
               on(kFlat, along({-8, 0.1, 5}, [](Way& way) {
                    way.to({-8, 0.1, 3}, 20, Due::kFree).to({-8, 0.1, 0.1}, 100, Due::kAny);
                    for (int i = 0; i < 1000; ++i) {
                      const double z = i % 3 == 0 ? -0x1p-52 : i % 3 == 1 ? 0.0 : kTiny;
                      way.jump({-8 + 0.016 * i, 0.1, i % 30 == 7 ? -kTiny : z}, Due::kAny);
                    }
                    way.to({8, 0.1, 3}, 100, Due::kAny).to({8, 0.1, 5}, 20, Due::kFree);
                  })));
  depths.quick(
      "depth-10x", "Ten times the model below a plane, slowly, and back.",
      on(kFlat,
         dipping(
             {.from = {-2.1, 1.3, 0}, .to = {2.2, -1.7, 0}, .out_mm = 5, .deep_mm = 200, .frames = 400})));
  depths.add("depth-10x-closed", "Through a ball to ten diameters behind it, and back by the same way.",
             on(kBall, along({0.4, 0.3, 20}, [](Way& way) {
                  way.to({0.4, 0.3, 15}, 50, Due::kFree).to({0.4, 0.3, 2}, 130, Due::kAny);
                  way.to({0.4, 0.3, -200}, 400, Due::kAny).to({0.4, 0.3, 15}, 400, Due::kAny);
                  way.to({0.4, 0.3, 20}, 50, Due::kFree);
                })));
}

void add_times(CaseGroup times) {
  times.add("time-20hz", "50 ms between frames.", waved(ticks(0.05)));
  times.add("time-20khz", "50 us between frames.", waved(ticks(5e-5)));
  times.quick("time-irregular", "From a nanosecond to a second between frames, at random.",
              waved([](StressSetup& setup) {
                Random random(3);
                double now_s = -1.0;
                for (double& t_s : setup.path.t_s) t_s = now_s += std::pow(10.0, random.uniform(-9.0, 0.0));
              }));
  times.add("time-one-ulp", "A clock at 1e9 s that advances by one rounding unit.",
            waved([](StressSetup& setup) {
              double now_s = 1e9;
              for (double& t_s : setup.path.t_s) t_s = now_s = std::nextafter(now_s, kInfinite);
            }));
  times.quick("time-aeons", "1e300 s between frames.", waved(ticks(1e300, -1e302)));
}

void add_stiffnesses(CaseGroup stiffnesses) {
  const auto stiff = [](double stiffness, double limit_n) {
    return [=](StressSetup& setup) {
      setup.scene.models.front().surface.stiffness_n_per_mm = stiffness;
      setup.scene.force_limit_n = limit_n;
    };
  };
  for (const double value : {1e-9, 1e3, 1e9, 1e150, 1e300})
    stiffnesses.add(fmt::format("stiffness-{:g}", value), fmt::format("A stiffness of {:g} N/mm.", value),
                    waved(stiff(value, kStressLimitN)), value == 1e300);
  stiffnesses.add("stiffness-denormal", "1e-310 N/mm: below the normal numbers.",
                  waved([stiff](StressSetup& setup) {
                    stiff(1e-310, kStressLimitN)(setup);
                    let_nothing_be_due(setup);
                  }));
  stiffnesses.add("limit-tiny", "A force limit of 1e-300 N.", waved(stiff(0.5, 1e-300)));
}

void add_surfaces(CaseGroup surfaces) {
  const auto felt = [](surface::Surface surface, double dt_s = 1e-3) {
    surface.stiffness_n_per_mm = kStressStiffness;
    return waved([=](StressSetup& setup) {
      setup.scene.models.front().surface = surface;
      ticks(dt_s)(setup);
      // A deep place may be free then.
      if (surface.dent.any()) let_nothing_be_due(setup);
    });
  };
  surface::Surface sticking, rough, soft, carved;
  sticking.friction = {1e6, 1e6};
  rough.friction = {0.7, 0.5};
  soft.deformation = std::nextafter(1.0, 0.0);
  carved.texture.kind = surface::TextureKind::kNoise;
  carved.texture.depth_mm = 1e6;
  carved.texture.wavelength_mm = 1e-6;
  surfaces.add("friction-1e6", "Friction of a million: it never slides.", felt(sticking));
  surfaces.add("friction-20hz", "Friction of 0.7 with 50 ms between frames.", felt(rough, 0.05));
  surfaces.add("deformation-1", "A deformation of one rounding unit less than all.", felt(soft));
  surfaces.add("texture-deep", "Noise carved a kilometre deep at a wavelength of a nanometre.", felt(carved));
  const auto dented = [](double radius_mm, double rate_mm_s) {
    surface::Surface surface;
    surface.dent = {0.1, radius_mm, rate_mm_s};
    return surface;
  };
  surfaces.quick("dent-fast", "Points that give way at a kilometre a second.", felt(dented(2.0, 1e6)));
  surfaces.add("dent-20hz", "Points that give way, 50 ms between frames.", felt(dented(2.0, 50.0), 0.05));
  surfaces.quick("dent-wide", "A dent ten times as wide as the model.", felt(dented(300.0, 50.0)));
}

/// Sets every tenth HIP to `bad` on one axis or all.
MakeSetup bad_hips(double bad) {
  return waved([bad](StressSetup& setup) {
    for (std::size_t i = 10; i < setup.path.size(); i += 10) {
      const std::size_t axis = i / 10 % 4;
      if (axis == 3)
        setup.path.hip_mm[i] = Vec3::Constant(bad);
      else
        setup.path.hip_mm[i][static_cast<Eigen::Index>(axis)] = bad;
      setup.due[i] = Due::kAny;
    }
    // A far HIP may have crossed anything.
    if (std::isfinite(bad)) std::fill(setup.due.begin(), setup.due.end(), Due::kAny);
  });
}

void add_probes(CaseGroup probes) {
  probes.quick("hip-nan", "Every tenth HIP is not a number.", bad_hips(kNoNumberAtAll));
  probes.add("hip-infinite", "Every tenth HIP is infinite.", bad_hips(kInfinite));
  probes.quick("hip-1e200", "Every tenth HIP at 1e200 mm, whose square overflows.", bad_hips(1e200));
  probes.quick("hip-1e308", "Every tenth HIP at 1.7e308 mm, the largest number.",
               bad_hips(-std::numeric_limits<double>::max()));
  probes.add("hip-1e40", "Every tenth HIP at 1e40 mm, beyond single precision.", bad_hips(1e40));
  probes.quick(
      "hip-denormal", "HIPs that are denormal numbers off a point at the origin.",
      on(kFlat, along({0, 0, 5}, [](Way& way) {
           way.to({0, 0, 3}, 20, Due::kFree).to({0, 0, 0.1}, 50, Due::kAny);
           for (int i = 0; i < 100; ++i)
             way.jump({kTiny * (i % 7), -kTiny * (i % 5), (i % 3 - 1) * kTiny * (1 << i % 20)}, Due::kAny);
           way.to({0, 0, 3}, 50, Due::kAny).to({0, 0, 5}, 20, Due::kFree);
         })));
  // Points are at multiples of 0.5 mm; so are edges, cell borders and box faces.
  probes.quick("hip-on-points", "The HIP exactly on points, edges, cell borders and faces of boxes.",
               on(kFlat, along({-5, 0, 5}, [](Way& way) {
                    way.to({-5, 0, 3}, 20, Due::kFree).to({-5, 0, 0.25}, 44, Due::kAny);
                    for (const double z : {0.25, 0.0, -0.25, -0.5})
                      for (int i = 0; i <= 80; ++i)
                        way.jump({-5 + 0.125 * i, 0.25 * (i % 3), z}, z < -0.2 ? Due::kInside : Due::kAny);
                    way.to({5, 0, 3}, 50, Due::kAny).to({5, 0, 5}, 20, Due::kFree);
                  })));
}

}  // namespace

void add_motion_cases(std::vector<StressCase>& cases) {
  add_speeds({cases, "speed"});
  add_depths({cases, "depth"});
  add_times({cases, "time"});
  add_stiffnesses({cases, "stiffness"});
  add_surfaces({cases, "surface"});
  add_probes({cases, "probe"});
}

// Scale, offset, number of points, threads.

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
