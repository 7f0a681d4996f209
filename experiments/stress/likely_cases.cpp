// Cases suspected from reading the code.
#include <cmath>
#include <numbers>

#include "experiments/stress/setups.h"
#include "experiments/stress/shapes.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

/// A plane with a renderer option far beyond its usual range.
MakeSetup with_option(const char* key, const char* value, const char* test = nullptr) {
  return on("sinusoid:extent_mm=30:amplitude_mm=1:wavelength_mm=20:spacing_mm=0.25", [=](StressSetup& setup) {
    setup.options.set(key, value);
    if (test != nullptr) setup.options.set("test", test);
    weave(setup, 60.0, 0.8, 50.0, 0.3, 300);
    let_nothing_be_due(setup);
  });
}

void add_options(CaseGroup& likely) {
  likely.quick("box-30mm", "Vertex boxes 120 spacings wide, each over hundreds of cells.",
               with_option("box_mm", "30"));
  likely.add("box-1e12mm", "Vertex boxes as large as the option allows.", with_option("box_mm", "1e12"));
  likely.quick("sphere-30mm", "A swept sphere 120 spacings wide.",
               with_option("sphere_mm", "30", "swept-sphere"));
  likely.add("cell-tiny", "Cells a thousandth of the resolution.", with_option("cell", "0.001"));
  likely.add("resolution-1e6mm", "A resolution of a kilometre, as the option says.",
             with_option("resolution_mm", "1e6"));
}

/// Points with `flying` more anywhere around them, none within `clear_mm` of the z axis.
Points with_flying(Points points, int flying, std::uint64_t seed, double clear_mm = 0.0) {
  Random random(seed);
  const auto length = [&] { return random.uniform(-14.0, 14.0); };
  for (int i = 0; i < flying;) {
    const Vec3 point{length(), length(), length()};
    if (point.head<2>().norm() < clear_mm) continue;
    points.push_back(point);
    ++i;
  }
  return points;
}

/// An open sheet of 1,681 points with `flying` more around it, pressed from above and below.
MakeSetup flying_sheet(int flying) {
  constexpr double kWayMm = 2.5;  // clearance: no added point is where the HIP goes
  return on(
      [flying] {
        return with_flying(lattice_points({-10, -10, 0}, {0.5, 0, 0}, {0, 0.5, 0}, 41, 41), flying, 12,
                           kWayMm);
      },
      "sheet with flying pixels", along({0.2, 0.1, 40}, [](Way& way) {
        for (const double side : {1.0, -1.0}) {
          if (side < 0.0) way.to({40, 0.1, 40}, 50, Due::kFree).to({40, 0.1, -40}, 50, Due::kFree);
          way.to({0.2, 0.1, side * 40}, 50, Due::kFree).to({0.2, 0.1, side * 30}, 30, Due::kFree);
          way.to({0.2, 0.1, side * -0.8}, 600, Due::kAny).stay(50, Due::kInside);
          way.to({0.2, 0.1, side * 30}, 300, Due::kAny).to({0.2, 0.1, side * 40}, 30, Due::kFree);
        }
      }));
}

void add_hollow(CaseGroup& likely) {
  likely.quick(
      "two-hollow-balls", "Start inside one of two hollow balls of one cloud, and press outwards.",
      on(
          [] {
            return joined_points(ball_points({-12, 0, 0}, 10.0, 5000), ball_points({12, 0, 0}, 10.0, 5000));
          },
          "two hollow balls", along({-12, 0.2, 0.1}, [](Way& way) {
            way.to({-18, 0.2, 0.1}, 100, Due::kFree).to({-23, 0.2, 0.1}, 100, [](const Vec3& p) {
              return p.x() < -22.4 ? Due::kInside : Due::kAny;
            });
            way.to({-18, 0.2, 0.1}, 100, Due::kAny).to({-12, 0.2, 0.1}, 100, Due::kFree);
          })));
  likely.add("hollow-ball", "Start inside a hollow ball and press outwards.",
             on([] { return ball_points(Vec3::Zero(), 10.0, 5000); }, "hollow ball",
                along({0, 0.2, 0.1}, [](Way& way) {
                  way.to({6, 0.2, 0.1}, 100, Due::kFree).to({11, 0.2, 0.1}, 100, [](const Vec3& p) {
                    return p.x() > 10.4 ? Due::kInside : Due::kAny;
                  });
                  way.to({6, 0.2, 0.1}, 100, Due::kAny).to({0, 0.2, 0.1}, 100, Due::kFree);
                })));
  likely.quick("flying-pixels", "A ball with one point in thirty thrown anywhere around it.",
               on([] { return with_flying(ball_points(Vec3::Zero(), 10.0, 6000), 200, 11); },
                  "ball with flying pixels", along({0.2, 0.1, 40}, [](Way& way) {
                    way.to({0.2, 0.1, 30}, 30, Due::kFree).to({0.2, 0.1, 9.2}, 300, Due::kAny);
                    way.stay(50, Due::kInside).to({0.2, 0.1, 30}, 300, Due::kAny);
                    way.to({0.2, 0.1, 40}, 30, Due::kFree);
                  })));
  likely.add("flying-sheet",
             "An open sheet with one point in ten thrown around it: pressed from above and from below, for "
             "it is not closed.",
             flying_sheet(170));
  likely.add("flying-fog", "The same sheet in a fog of as many points as it has, whose normals are any.",
             flying_sheet(1700));
}

/// A cone of rings with as many points each, and its tip.
Points ringed_cone(int around) {
  Points points = {{0, 0, 5}};
  for (int ring = 1; ring <= 10; ++ring)
    for (int i = 0; i < around; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / around;
      points.emplace_back(0.5 * ring * std::cos(angle), 0.5 * ring * std::sin(angle), 5.0 - 0.5 * ring);
    }
  return points;
}

void add_crowds(CaseGroup& likely) {
  likely.quick(
      "crowd", "Forty thousand points within a millimetre of a coarse plane.",
      on(
          [] {
            return joined_points(lattice_points({-10, -10, 0}, {0.5, 0, 0}, {0, 0.5, 0}, 41, 41),
                                 lattice_points({-0.499, -0.499, 0}, {0.005, 0, 0}, {0, 0.005, 0}, 200, 200));
          },
          "crowded plane",
          dipping(
              {.from = {-4.1, 0.1, 0}, .to = {4.3, 0.2, 0}, .out_mm = 5.0, .felt_mm = 0.3, .frames = 200})));
  likely.quick("apex-400", "A cone whose tip has four hundred neighbours around it.",
               on([] { return ringed_cone(400); }, "cone of 400", along({0.01, 0.02, 12}, [](Way& way) {
                    way.to({0.01, 0.02, 9}, 50, Due::kFree).to({0.01, 0.02, 4}, 150, Due::kAny);
                    for (int i = 0; i <= 300; ++i)
                      way.jump({0.2 * std::cos(0.1 * i), 0.2 * std::sin(0.1 * i), 4.4}, Due::kAny);
                    way.to({0.2, 0.02, 9}, 150, Due::kAny).to({0.2, 0.02, 12}, 50, Due::kFree);
                  })));
}

void stroke_relief(StressSetup& setup) {
  const auto surface = setup.scene.models.front().analytic;
  const double top = surface->box_mm().high_mm.z(), low = surface->box_mm().low_mm.z();
  const auto due = [surface, top](const Vec3& p) {
    return p.z() > top + 2.5 ? Due::kFree : surface->signed_distance_mm(p) < -0.3 ? Due::kInside : Due::kAny;
  };
  Way way({-14, -9, top + 4});
  for (int i = 0; i < 40; ++i) {  // 3 mm in each frame
    const double side = i % 2 == 0 ? 1.0 : -1.0, y = -9.0 + 0.45 * i;
    way.to({side * 3, y, low - 0.5}, 6, due).to({side * 14, y, top + 4}, 5, due);
  }
  std::move(way).put_into(setup);
}

void add_fast(CaseGroup& likely) {
  likely.quick("fast-relief", "Over relief of 1 mm waves at 3 m/s, coming in at a slant.",
               on("relief:extent_mm=40:finest_mm=1:spacing_mm=0.2", stroke_relief));
  likely.quick("jump-in", "From 4 mm above a plane to 5 mm below it in one frame, and back.",
               on("plane:extent_mm=20:spacing_mm=0.5", along({1.1, 0.3, 4}, [](Way& way) {
                    for (int i = 0; i < 20; ++i) {
                      way.jump({1.1 + 0.1 * i, 0.3, -5}, Due::kInside).stay(5, Due::kInside);
                      way.jump({1.1 + 0.1 * i, 0.3, 4}, Due::kFree).stay(5, Due::kFree);
                    }
                  })));
  likely.add("deep-slide", "5 mm below a plane of points 0.2 mm apart, at a hand's pace.",
             on("plane:extent_mm=20:spacing_mm=0.2",
                dipping({.from = {-3.1, 2.2, 0}, .to = {3.3, -1.7, 0}, .deep_mm = 5.0, .frames = 150})));
}

/// A cylinder with a deep narrow pit. The path goes into the pit and around below its bottom, then under the
/// cylinder and across its flat end; `count` facets meet at each centre.
MakeSetup turned_setup(int count) {
  static constexpr double kStepMm = 1.0, kRoundMm = 1.7, kTurns = 2.0;
  static constexpr int kFrames = 300;
  const Change into_pit = along({0.1, 0.05, 20}, [](Way& way) {
    way.to({0.1, 0.05, 16}, 50, Due::kFree).to({0.1, 0.05, -1}, 250, Due::kAny);
    way.stay(5, Due::kInside).to({kRoundMm, 0, -1}, 50, Due::kInside);
    for (int k = 0; k <= kFrames; ++k) {
      const double angle = kTurns * 2.0 * std::numbers::pi * k / kFrames;
      way.jump({kRoundMm * std::cos(angle), kRoundMm * std::sin(angle), -1}, Due::kInside);
    }
    way.to({0.1, 0.05, -1}, 50, Due::kInside).to({0.1, 0.05, 16}, 250, Due::kAny);
    way.to({20, 0, 16}, 100, Due::kFree)
        .to({20, 0, -14}, 100, Due::kFree)
        .to({2.5, 0.1, -14}, 100, Due::kFree);
    way.to({2.5, 0.1, -5}, 200, [](const Vec3& p) { return p.z() > -5.5 ? Due::kInside : Due::kAny; });
    way.to({-2.4, -0.1, -5}, 100, Due::kInside).to({-2.4, -0.1, -12}, 200, Due::kAny);
    way.to({-2.4, -0.1, -14}, 30, Due::kFree);
  });
  return [=]() -> Result<StressSetup> {
    auto mesh = std::make_shared<const geometry::TriangleMesh>(
        turned_mesh({{0, -6}, {8, -6}, {8, 10}, {2, 10}, {0, 0}}, kStepMm, count));
    PALPATE_ASSIGN(StressSetup setup, setup_of_points(mesh->vertices_mm, "turned body"));
    setup.scene.models.front().original_mesh = std::move(mesh);
    setup.options.set("mesh", "original");  // renderers without a mesh skip the case
    into_pit(setup);
    return setup;
  };
}

}  // namespace

void add_likely_cases(std::vector<StressCase>& cases) {
  CaseGroup likely(cases, "likely");
  add_options(likely);
  add_hollow(likely);
  add_crowds(likely);
  add_fast(likely);
  likely.quick("fan-400", "A mesh of a turned body, four hundred facets around each end of its axis.",
               turned_setup(400));
  likely.add("fan-1000", "The same with a thousand.", turned_setup(1000));
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
