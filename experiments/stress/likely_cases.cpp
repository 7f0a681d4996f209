// Cases suspected from reading the code.
#include <algorithm>
#include <cmath>
#include <numbers>

#include <palpate/result.h>
#include "experiments/stress/setups.h"
#include "experiments/stress/shapes.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

using Points = std::vector<Vec3>;

/// A plane with a renderer option far beyond its usual range.
std::function<Result<StressSetup>()> with_option(const char* key, const char* value,
                                                 const char* also = nullptr,
                                                 const char* also_value = nullptr) {
  return [=]() -> Result<StressSetup> {
    PALPATE_ASSIGN(
        StressSetup setup,
        setup_of_generator("sinusoid:extent_mm=30:amplitude_mm=1:wavelength_mm=20:spacing_mm=0.25"));
    setup.options.set(key, value);
    if (also != nullptr) setup.options.set(also, also_value);
    const auto surface = setup.scene.models.front().analytic;
    weave(setup, *surface, 60.0, 0.8, 50.0, 0.3, 300);
    for (Due& due : setup.due) due = due == Due::kInside ? Due::kAny : due;
    return setup;
  };
}

void add_options(std::vector<StressCase>& cases) {
  cases.push_back({"box-30mm", "likely", "Vertex boxes 120 spacings wide, each over hundreds of cells.", true,
                   false, with_option("box_mm", "30")});
  cases.push_back({"box-1e12mm", "likely", "Vertex boxes as large as the option allows.", false, false,
                   with_option("box_mm", "1e12")});
  cases.push_back({"sphere-30mm", "likely", "A swept sphere 120 spacings wide.", true, false,
                   with_option("sphere_mm", "30", "test", "swept-sphere")});
  cases.push_back({"cell-tiny", "likely", "Cells a thousandth of the resolution.", false, false,
                   with_option("cell", "0.001")});
  cases.push_back({"resolution-1e6mm", "likely", "A resolution of a kilometre, as the option says.", false,
                   false, with_option("resolution_mm", "1e6")});
}

/// An open sheet of 1,681 points with `flying` more around it, pressed from above and below.
Result<StressSetup> flying_sheet(int flying) {
  constexpr double kWayMm = 2.5;  // clearance: no added point is where the HIP goes
  Points points = lattice_points({-10, -10, 0}, {0.5, 0, 0}, {0, 0.5, 0}, 41, 41);
  Random random(12);
  const auto length = [&] { return random.uniform(-14.0, 14.0); };
  for (int i = 0; i < flying;) {
    const Vec3 point{length(), length(), length()};
    if (point.head<2>().norm() < kWayMm) continue;
    points.push_back(point);
    ++i;
  }
  PALPATE_ASSIGN(StressSetup setup, setup_of_points(points, "sheet with flying pixels"));
  Way way({0.2, 0.1, 40});
  for (const double side : {1.0, -1.0}) {
    if (side < 0.0) way.to({40, 0.1, 40}, 50, Due::kFree).to({40, 0.1, -40}, 50, Due::kFree);
    way.to({0.2, 0.1, side * 40}, 50, Due::kFree).to({0.2, 0.1, side * 30}, 30, Due::kFree);
    way.to({0.2, 0.1, side * -0.8}, 600, Due::kAny).stay(50, Due::kInside);
    way.to({0.2, 0.1, side * 30}, 300, Due::kAny);
    way.to({0.2, 0.1, side * 40}, 30, Due::kFree);
  }
  std::move(way).put_into(setup);
  return setup;
}

void add_hollow(std::vector<StressCase>& cases) {
  cases.push_back(
      {"two-hollow-balls", "likely", "Start inside one of two hollow balls of one cloud, and press outwards.",
       true, false, []() -> Result<StressSetup> {
         Points points = ball_points({-12, 0, 0}, 10.0, 5000), other = ball_points({12, 0, 0}, 10.0, 5000);
         points.insert(points.end(), other.begin(), other.end());
         PALPATE_ASSIGN(StressSetup setup, setup_of_points(points, "two hollow balls"));
         Way way({-12, 0.2, 0.1});
         way.to({-18, 0.2, 0.1}, 100, Due::kFree).to({-23, 0.2, 0.1}, 100, [](const Vec3& p) {
           return p.x() < -22.4 ? Due::kInside : Due::kAny;
         });
         way.to({-18, 0.2, 0.1}, 100, Due::kAny).to({-12, 0.2, 0.1}, 100, Due::kFree);
         std::move(way).put_into(setup);
         return setup;
       }});
  cases.push_back({"hollow-ball", "likely", "Start inside a hollow ball and press outwards.", false, false,
                   []() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup,
                                    setup_of_points(ball_points(Vec3::Zero(), 10.0, 5000), "hollow ball"));
                     Way way({0, 0.2, 0.1});
                     way.to({6, 0.2, 0.1}, 100, Due::kFree).to({11, 0.2, 0.1}, 100, [](const Vec3& p) {
                       return p.x() > 10.4 ? Due::kInside : Due::kAny;
                     });
                     way.to({6, 0.2, 0.1}, 100, Due::kAny).to({0, 0.2, 0.1}, 100, Due::kFree);
                     std::move(way).put_into(setup);
                     return setup;
                   }});
  cases.push_back(
      {"flying-pixels", "likely", "A ball with one point in thirty thrown anywhere around it.", true, false,
       []() -> Result<StressSetup> {
         Points points = ball_points(Vec3::Zero(), 10.0, 6000);
         Random random(11);
         const auto length = [&] { return random.uniform(-14.0, 14.0); };
         for (int i = 0; i < 200; ++i) points.push_back(Vec3{length(), length(), length()});
         PALPATE_ASSIGN(StressSetup setup, setup_of_points(points, "ball with flying pixels"));
         Way way({0.2, 0.1, 40});
         way.to({0.2, 0.1, 30}, 30, Due::kFree).to({0.2, 0.1, 9.2}, 300, Due::kAny);
         way.stay(50, Due::kInside).to({0.2, 0.1, 30}, 300, Due::kAny).to({0.2, 0.1, 40}, 30, Due::kFree);
         std::move(way).put_into(setup);
         return setup;
       }});
  cases.push_back({"flying-sheet", "likely",
                   "An open sheet with one point in ten thrown around it: pressed from above and from below, "
                   "for it is not closed.",
                   false, false, [] { return flying_sheet(170); }});
  cases.push_back({"flying-fog", "likely",
                   "The same sheet in a fog of as many points as it has, whose normals are any.", false,
                   false, [] { return flying_sheet(1700); }});
}

void add_crowds(std::vector<StressCase>& cases) {
  cases.push_back(
      {"crowd", "likely", "Forty thousand points within a millimetre of a coarse plane.", true, false,
       []() -> Result<StressSetup> {
         Points points = lattice_points({-10, -10, 0}, {0.5, 0, 0}, {0, 0.5, 0}, 41, 41);
         const Points crowd = lattice_points({-0.499, -0.499, 0}, {0.005, 0, 0}, {0, 0.005, 0}, 200, 200);
         points.insert(points.end(), crowd.begin(), crowd.end());
         PALPATE_ASSIGN(StressSetup setup, setup_of_points(points, "crowded plane"));
         Dip d{{-4.1, 0.1, 0}, {4.3, 0.2, 0}};
         d.out_mm = 5.0;
         d.felt_mm = 0.3;
         d.frames = 200;
         dip(setup, d);
         return setup;
       }});
  cases.push_back({"apex-400", "likely", "A cone whose tip has four hundred neighbours around it.", true,
                   false, []() -> Result<StressSetup> {
                     Points points = {{0, 0, 5}};
                     constexpr int kAround = 400;
                     for (int ring = 1; ring <= 10; ++ring)
                       for (int i = 0; i < kAround; ++i) {
                         const double angle = 2.0 * std::numbers::pi * i / kAround;
                         points.emplace_back(0.5 * ring * std::cos(angle), 0.5 * ring * std::sin(angle),
                                             5.0 - 0.5 * ring);
                       }
                     PALPATE_ASSIGN(StressSetup setup, setup_of_points(points, "cone of 400"));
                     Way way({0.01, 0.02, 12});
                     way.to({0.01, 0.02, 9}, 50, Due::kFree).to({0.01, 0.02, 4}, 150, Due::kAny);
                     for (int i = 0; i <= 300; ++i) {
                       const double angle = 0.1 * i;
                       way.jump({0.2 * std::cos(angle), 0.2 * std::sin(angle), 4.4}, Due::kAny);
                     }
                     way.to({0.2, 0.02, 9}, 150, Due::kAny).to({0.2, 0.02, 12}, 50, Due::kFree);
                     std::move(way).put_into(setup);
                     return setup;
                   }});
}

void add_fast(std::vector<StressCase>& cases) {
  cases.push_back({"fast-relief", "likely", "Over relief of 1 mm waves at 3 m/s, coming in at a slant.", true,
                   false, []() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup,
                                    setup_of_generator("relief:extent_mm=40:finest_mm=1:spacing_mm=0.2"));
                     const auto surface = setup.scene.models.front().analytic;
                     const double top = surface->box_mm().high_mm.z(), low = surface->box_mm().low_mm.z();
                     const auto due = [surface, top](const Vec3& p) {
                       return p.z() > top + 2.5                       ? Due::kFree
                              : surface->signed_distance_mm(p) < -0.3 ? Due::kInside
                                                                      : Due::kAny;
                     };
                     Way way({-14, -9, top + 4});
                     for (int i = 0; i < 40; ++i) {  // 3 mm in each frame
                       const double side = i % 2 == 0 ? 1.0 : -1.0, y = -9.0 + 0.45 * i;
                       way.to({side * 3, y, low - 0.5}, 6, due).to({side * 14, y, top + 4}, 5, due);
                     }
                     std::move(way).put_into(setup);
                     return setup;
                   }});
  cases.push_back({"jump-in", "likely", "From 4 mm above a plane to 5 mm below it in one frame, and back.",
                   true, false, []() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup,
                                    setup_of_generator("plane:extent_mm=20:spacing_mm=0.5"));
                     Way way({1.1, 0.3, 4});
                     for (int i = 0; i < 20; ++i) {
                       way.jump({1.1 + 0.1 * i, 0.3, -5}, Due::kInside).stay(5, Due::kInside);
                       way.jump({1.1 + 0.1 * i, 0.3, 4}, Due::kFree).stay(5, Due::kFree);
                     }
                     std::move(way).put_into(setup);
                     return setup;
                   }});
  cases.push_back({"deep-slide", "likely", "5 mm below a plane of points 0.2 mm apart, at a hand's pace.",
                   false, false, []() -> Result<StressSetup> {
                     PALPATE_ASSIGN(StressSetup setup,
                                    setup_of_generator("plane:extent_mm=20:spacing_mm=0.2"));
                     Dip d{{-3.1, 2.2, 0}, {3.3, -1.7, 0}};
                     d.deep_mm = 5.0;
                     d.frames = 150;
                     dip(setup, d);
                     return setup;
                   }});
}

/// A cylinder with a deep narrow pit. The path goes into the pit and around below its bottom, then under the
/// cylinder and across its flat end; `count` facets meet at each centre.
Result<StressSetup> turned_setup(int count) {
  constexpr double kStepMm = 1.0, kRoundMm = 1.7, kTurns = 2.0;
  constexpr int kFrames = 300;
  const geometry::TriangleMesh mesh =
      turned_mesh({{0, -6}, {8, -6}, {8, 10}, {2, 10}, {0, 0}}, kStepMm, count);
  PALPATE_ASSIGN(StressSetup setup, setup_of_points(mesh.vertices_mm, "turned body"));
  setup.scene.models.front().original_mesh = std::make_shared<const geometry::TriangleMesh>(mesh);
  setup.options.set("mesh", "original");
  Way way({0.1, 0.05, 20});
  way.to({0.1, 0.05, 16}, 50, Due::kFree).to({0.1, 0.05, -1}, 250, Due::kAny);
  way.stay(5, Due::kInside).to({kRoundMm, 0, -1}, 50, Due::kInside);
  for (int k = 0; k <= kFrames; ++k) {
    const double angle = kTurns * 2.0 * std::numbers::pi * k / kFrames;
    way.jump({kRoundMm * std::cos(angle), kRoundMm * std::sin(angle), -1}, Due::kInside);
  }
  way.to({0.1, 0.05, -1}, 50, Due::kInside).to({0.1, 0.05, 16}, 250, Due::kAny);
  way.to({20, 0, 16}, 100, Due::kFree).to({20, 0, -14}, 100, Due::kFree).to({2.5, 0.1, -14}, 100, Due::kFree);
  way.to({2.5, 0.1, -5}, 200, [](const Vec3& p) { return p.z() > -5.5 ? Due::kInside : Due::kAny; });
  way.to({-2.4, -0.1, -5}, 100, Due::kInside).to({-2.4, -0.1, -12}, 200, Due::kAny);
  way.to({-2.4, -0.1, -14}, 30, Due::kFree);
  std::move(way).put_into(setup);
  return setup;
}

/// Skipped by renderers without a mesh.
void add_fans(std::vector<StressCase>& cases) {
  cases.push_back({"fan-400", "likely",
                   "A mesh of a turned body, four hundred facets around each end of its axis.", true, false,
                   [] { return turned_setup(400); }});
  cases.push_back(
      {"fan-1000", "likely", "The same with a thousand.", false, false, [] { return turned_setup(1000); }});
}

}  // namespace

void add_likely_cases(std::vector<StressCase>& cases) {
  add_options(cases);
  add_hollow(cases);
  add_crowds(cases);
  add_fast(cases);
  add_fans(cases);
}

std::vector<StressCase> stress_cases() {
  std::vector<StressCase> cases;
  add_number_cases(cases);
  add_motion_cases(cases);
  add_cloud_cases(cases);
  add_body_cases(cases);
  add_likely_cases(cases);
  return cases;
}

}  // namespace palpate::experiments
