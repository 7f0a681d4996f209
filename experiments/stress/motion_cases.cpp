// Extreme probe motions, surfaces and HIPs.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include <palpate/result.h>
#include "experiments/stress/setups.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

constexpr const char* kPatch = "sinusoid:extent_mm=30:amplitude_mm=1:wavelength_mm=20:spacing_mm=0.5";
constexpr const char* kFlat = "plane:extent_mm=20:spacing_mm=0.5";
constexpr const char* kBall = "sphere:extent_mm=20:points=5000";
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNoNumberAtAll = std::numeric_limits<double>::quiet_NaN();

using Change = std::function<void(StressSetup&)>;

/// A wave at hand speed with one change.
std::function<Result<StressSetup>()> waved(Change change) {
  return [change = std::move(change)]() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_generator(kPatch));
    const auto surface = setup.scene.models.front().analytic;
    weave(setup, *surface, 5.0, 0.8, 3.0, 0.2, 400);
    change(setup);
    return setup;
  };
}
/// A plane with its own path.
std::function<Result<StressSetup>()> over(const char* generator, Change way) {
  return [generator, way = std::move(way)]() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_generator(generator));
    way(setup);
    return setup;
  };
}

Change ticks(double dt_s, double start_s = 0.0) {
  return [=](StressSetup& setup) {
    for (std::size_t i = 0; i < setup.path.size(); ++i)
      setup.path.t_s[i] = start_s + dt_s * static_cast<double>(i);
  };
}

void add_speeds(std::vector<StressCase>& cases) {
  cases.push_back(
      {"speed-0", "speed", "At rest half a millimetre deep for 300 frames.", false, false,
       over(kFlat, [](StressSetup& setup) {
         Way way({0.13, 0.21, 5});
         way.to({0.13, 0.21, 3}, 20, Due::kFree).to({0.13, 0.21, -0.5}, 60, Due::kAny);
         way.stay(300, Due::kInside).to({0.13, 0.21, 3}, 60, Due::kAny).to({0.13, 0.21, 5}, 20, Due::kFree);
         std::move(way).put_into(setup);
       })});
  for (const double speed : {0.1, 1.0, 10.0}) {  // m/s, equal to mm per 1 ms frame
    cases.push_back(
        {fmt::format("speed-{:g}", speed), "speed",
         fmt::format("Into a ball and out again at {:g} m/s, and across its middle.", speed), speed == 10.0,
         false, over(kBall, [speed](StressSetup& setup) {
           // Deep frames that began outside are due; across, either side may hold.
           Way way({0.3, 0.2, 40});
           const auto steps = [speed](double mm) { return std::max(2, static_cast<int>(mm / speed)); };
           way.to({0.3, 0.2, 16}, steps(24), Due::kFree).to({0.3, 0.2, 5}, steps(11), [](const Vec3& p) {
             return p.norm() < 9.5 ? Due::kInside : Due::kAny;
           });
           way.to({0.3, 0.2, 16}, steps(11), Due::kAny).to({0.3, 0.2, 40}, steps(24), Due::kFree);
           way.to({0.3, 0.2, -40}, steps(80), Due::kAny).to({35, 0, -20}, steps(40), Due::kAny);
           way.to({0.3, 0.2, 40}, steps(70), Due::kAny).stay(5, Due::kFree);
           std::move(way).put_into(setup);
         })});
  }
  cases.push_back({"teleport", "speed", "A place anywhere within ten models in every frame.", true, false,
                   over(kBall, [](StressSetup& setup) {
                     Random random(7);
                     const auto length = [&] { return random.uniform(-100.0, 100.0); };
                     Way way({0, 0, 50});
                     for (int i = 0; i < 1000; ++i) way.jump(Vec3{length(), length(), length()}, Due::kAny);
                     way.jump({0, 0, 50}, Due::kAny).stay(3, Due::kAny);
                     std::move(way).put_into(setup);
                   })});
}

void add_depths(std::vector<StressCase>& cases) {
  cases.push_back({"depth-ulp", "depth",
                   "One rounding unit below, on and above the surface, at 1,000 places.", true, false,
                   over(kFlat, [](StressSetup& setup) {
                     Way way({-8, 0.1, 5});
                     way.to({-8, 0.1, 3}, 20, Due::kFree).to({-8, 0.1, 0.1}, 100, Due::kAny);
                     for (int i = 0; i < 1000; ++i) {
                       const double ulp = std::numeric_limits<double>::denorm_min();
                       const double z = i % 3 == 0 ? -0x1p-52 : i % 3 == 1 ? 0.0 : ulp;
                       way.jump({-8 + 0.016 * i, 0.1, i % 30 == 7 ? -ulp : z}, Due::kAny);
                     }
                     way.to({8, 0.1, 3}, 100, Due::kAny).to({8, 0.1, 5}, 20, Due::kFree);
                     std::move(way).put_into(setup);
                   })});
  cases.push_back({"depth-10x", "depth", "Ten times the model below a plane, slowly, and back.", true, false,
                   over(kFlat, [](StressSetup& setup) {
                     Dip d{{-2.1, 1.3, 0}, {2.2, -1.7, 0}};
                     d.out_mm = 5;
                     d.deep_mm = 200;
                     d.frames = 400;
                     dip(setup, d);
                   })});
  cases.push_back({"depth-10x-closed", "depth",
                   "Through a ball to ten diameters behind it, and back by the same way.", false, false,
                   over(kBall, [](StressSetup& setup) {
                     Way way({0.4, 0.3, 20});
                     way.to({0.4, 0.3, 15}, 50, Due::kFree).to({0.4, 0.3, 2}, 130, Due::kAny);
                     way.to({0.4, 0.3, -200}, 400, Due::kAny).to({0.4, 0.3, 15}, 400, Due::kAny);
                     way.to({0.4, 0.3, 20}, 50, Due::kFree);
                     std::move(way).put_into(setup);
                   })});
}

void add_times(std::vector<StressCase>& cases) {
  cases.push_back({"time-20hz", "time", "50 ms between frames.", false, false, waved(ticks(0.05))});
  cases.push_back({"time-20khz", "time", "50 us between frames.", false, false, waved(ticks(5e-5))});
  cases.push_back({"time-irregular", "time", "From a nanosecond to a second between frames, at random.", true,
                   false, waved([](StressSetup& setup) {
                     Random random(3);
                     double now_s = -1.0;
                     for (double& t_s : setup.path.t_s)
                       t_s = now_s += std::pow(10.0, random.uniform(-9.0, 0.0));
                   })});
  cases.push_back({"time-one-ulp", "time", "A clock at 1e9 s that advances by one rounding unit.", false,
                   false, waved([](StressSetup& setup) {
                     double now_s = 1e9;
                     for (double& t_s : setup.path.t_s) t_s = now_s = std::nextafter(now_s, kInfinite);
                   })});
  cases.push_back(
      {"time-aeons", "time", "1e300 s between frames.", true, false, waved(ticks(1e300, -1e302))});
}

void add_stiffnesses(std::vector<StressCase>& cases) {
  const auto stiff = [](double stiffness, double limit_n) {
    return [=](StressSetup& setup) {
      setup.scene.models.front().surface.stiffness_n_per_mm = stiffness;
      setup.scene.force_limit_n = limit_n;
    };
  };
  for (const double value : {1e-9, 1e3, 1e9, 1e150, 1e300})
    cases.push_back({fmt::format("stiffness-{:g}", value), "stiffness",
                     fmt::format("A stiffness of {:g} N/mm.", value), value == 1e300, false,
                     waved(stiff(value, kStressLimitN))});
  cases.push_back({"stiffness-denormal", "stiffness", "1e-310 N/mm: below the normal numbers.", false, false,
                   waved([stiff](StressSetup& setup) {
                     stiff(1e-310, kStressLimitN)(setup);
                     for (Due& due : setup.due) due = due == Due::kInside ? Due::kAny : due;
                   })});
  cases.push_back(
      {"limit-tiny", "stiffness", "A force limit of 1e-300 N.", false, false, waved(stiff(0.5, 1e-300))});
}

void add_surfaces(std::vector<StressCase>& cases) {
  const auto surface = [](auto set, double dt_s = 1e-3) {
    return waved([set, dt_s](StressSetup& setup) {
      set(setup.scene.models.front().surface);
      ticks(dt_s)(setup);
      if (setup.scene.models.front().surface.dent.any())  // on deformable surfaces what is deep now may be
                                                          // free then
        for (Due& due : setup.due) due = due == Due::kInside ? Due::kAny : due;
    });
  };
  cases.push_back({"friction-1e6", "surface", "Friction of a million: it never slides.", false, false,
                   surface([](surface::Surface& s) {
                     s.friction = {1e6, 1e6};
                   })});
  cases.push_back({"friction-20hz", "surface", "Friction of 0.7 with 50 ms between frames.", false, false,
                   surface(
                       [](surface::Surface& s) {
                         s.friction = {0.7, 0.5};
                       },
                       0.05)});
  cases.push_back({"deformation-1", "surface", "A deformation of one rounding unit less than all.", false,
                   false, surface([](surface::Surface& s) { s.deformation = std::nextafter(1.0, 0.0); })});
  cases.push_back({"texture-deep", "surface", "Noise carved a kilometre deep at a wavelength of a nanometre.",
                   false, false, surface([](surface::Surface& s) {
                     s.texture.kind = surface::TextureKind::kNoise;
                     s.texture.depth_mm = 1e6;
                     s.texture.wavelength_mm = 1e-6;
                   })});
  const auto dent = [](double radius_mm, double rate_mm_s) {
    return [=](surface::Surface& s) { s.dent = {0.1, radius_mm, rate_mm_s}; };
  };
  cases.push_back({"dent-fast", "surface", "Points that give way at a kilometre a second.", true, false,
                   surface(dent(2.0, 1e6))});
  cases.push_back({"dent-20hz", "surface", "Points that give way, 50 ms between frames.", false, false,
                   surface(dent(2.0, 50.0), 0.05)});
  cases.push_back({"dent-wide", "surface", "A dent ten times as wide as the model.", true, false,
                   surface(dent(300.0, 50.0))});
}

/// Sets every tenth HIP to `bad` on one axis or all.
Change bad_hips(double bad) {
  return [bad](StressSetup& setup) {
    for (std::size_t i = 10; i < setup.path.size(); i += 10) {
      const std::size_t axis = i / 10 % 4;
      if (axis == 3)
        setup.path.hip_mm[i] = Vec3::Constant(bad);
      else
        setup.path.hip_mm[i][static_cast<Eigen::Index>(axis)] = bad;
      setup.due[i] = Due::kAny;
      // A far HIP may have crossed anything: frames up to the next clear place are undecided.
    }
    if (std::isfinite(bad)) std::fill(setup.due.begin(), setup.due.end(), Due::kAny);
  };
}

void add_probes(std::vector<StressCase>& cases) {
  cases.push_back(
      {"hip-nan", "probe", "Every tenth HIP is not a number.", true, false, waved(bad_hips(kNoNumberAtAll))});
  cases.push_back(
      {"hip-infinite", "probe", "Every tenth HIP is infinite.", false, false, waved(bad_hips(kInfinite))});
  cases.push_back({"hip-1e200", "probe", "Every tenth HIP at 1e200 mm, whose square overflows.", true, false,
                   waved(bad_hips(1e200))});
  cases.push_back({"hip-1e308", "probe", "Every tenth HIP at 1.7e308 mm, the largest number.", true, false,
                   waved(bad_hips(-std::numeric_limits<double>::max()))});
  cases.push_back({"hip-1e40", "probe", "Every tenth HIP at 1e40 mm, beyond single precision.", false, false,
                   waved(bad_hips(1e40))});
  cases.push_back(
      {"hip-denormal", "probe", "HIPs that are denormal numbers off a point at the origin.", true, false,
       over(kFlat, [](StressSetup& setup) {
         const double tiny = std::numeric_limits<double>::denorm_min();
         Way way({0, 0, 5});
         way.to({0, 0, 3}, 20, Due::kFree).to({0, 0, 0.1}, 50, Due::kAny);
         for (int i = 0; i < 100; ++i)
           way.jump({tiny * (i % 7), -tiny * (i % 5), (i % 3 - 1) * tiny * (1 << i % 20)}, Due::kAny);
         way.to({0, 0, 3}, 50, Due::kAny).to({0, 0, 5}, 20, Due::kFree);
         std::move(way).put_into(setup);
       })});
  // Points are at multiples of 0.5 mm; so are edges, cell borders and box faces.
  cases.push_back({"hip-on-points", "probe",
                   "The HIP exactly on points, edges, cell borders and faces of boxes.", true, false,
                   over(kFlat, [](StressSetup& setup) {
                     Way way({-5, 0, 5});
                     way.to({-5, 0, 3}, 20, Due::kFree).to({-5, 0, 0.25}, 44, Due::kAny);
                     for (const double z : {0.25, 0.0, -0.25, -0.5})
                       for (int i = 0; i <= 80; ++i)
                         way.jump({-5 + 0.125 * i, 0.25 * (i % 3), z}, z < -0.2 ? Due::kInside : Due::kAny);
                     way.to({5, 0, 3}, 50, Due::kAny).to({5, 0, 5}, 20, Due::kFree);
                     std::move(way).put_into(setup);
                   })});
}

}  // namespace

void add_motion_cases(std::vector<StressCase>& cases) {
  add_speeds(cases);
  add_depths(cases);
  add_times(cases);
  add_stiffnesses(cases);
  add_surfaces(cases);
  add_probes(cases);
}

}  // namespace palpate::experiments
