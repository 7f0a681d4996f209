// Clouds of extreme spacings, and clouds that are hardly surfaces.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include <palpate/result.h>
#include "experiments/stress/setups.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

using Points = std::vector<Vec3>;

/// Square rings around the origin in the plane z = 0, each with twice the spacing of the one inside it.
Points graded_plane(double finest_mm, int rings) {
  constexpr int kHalf = 8;  // half of a ring's outer edge, in its spacing
  Points points;
  double step = finest_mm;
  for (int ring = 0; ring < rings; ++ring, step *= 2.0)
    for (int j = -kHalf; j <= kHalf; ++j)
      for (int i = -kHalf; i <= kHalf; ++i)
        if (ring == 0 || std::max(std::abs(i), std::abs(j)) > kHalf / 2)
          points.emplace_back(i * step, j * step, 0.0);
  return points;
}

Points lattice(int half, double step_mm, double z_mm = 0.0) {
  Points points;
  for (int j = -half; j <= half; ++j)
    for (int i = -half; i <= half; ++i) points.emplace_back(i * step_mm, j * step_mm, z_mm);
  return points;
}

/// A cloud with a dip through it at one place.
std::function<Result<StressSetup>()> dipped(std::function<Points()> points, const char* name, Dip way) {
  return [=]() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_points(points(), name));
    dip(setup, way);
    return setup;
  };
}
/// The same without an expected force: only free above `clear_mm`.
std::function<Result<StressSetup>()> crossed(std::function<Points()> points, const char* name, double out_mm,
                                             double clear_mm, Vec3 at = {0.05, 0.03, 0}) {
  Dip way{at, at + Vec3(0.4, 0.3, 0)};
  way.out_mm = out_mm;
  way.clear_mm = clear_mm;
  way.deep_mm = 0.5 * out_mm;
  way.felt_mm = std::numeric_limits<double>::infinity();
  return dipped(std::move(points), name, way);
}

void add_spacings(std::vector<StressCase>& cases) {
  struct Grade {
    const char* name;
    double finest_mm;
    int rings;
    bool quick;
  };
  for (const Grade& g : {Grade{"spacing-1:100", 0.1, 8, false}, {"spacing-1:10000", 1e-3, 15, true}}) {
    const double coarsest = g.finest_mm * std::exp2(g.rings - 1);
    const auto points = [g] { return graded_plane(g.finest_mm, g.rings); };
    Dip fine{{0.1 * g.finest_mm, 0.2 * g.finest_mm, 0}, {3.3 * g.finest_mm, -2.1 * g.finest_mm, 0}};
    fine.out_mm = 5 * coarsest;
    fine.clear_mm = 4 * coarsest;
    fine.deep_mm = 0.5;
    fine.frames = 400;
    cases.push_back({g.name, "spacing",
                     "A plane of squares with spacings doubled from ring to ring, felt in the middle.",
                     g.quick, false, dipped(points, "graded plane", fine)});
    Dip coarse = fine;
    coarse.from = {5.1 * coarsest, 0.3 * coarsest, 0};
    coarse.to = {-4.9 * coarsest, 0.9 * coarsest, 0};
    cases.push_back({fmt::format("{}-across", g.name), "spacing",
                     "The same plane, from ring to ring across the middle.", false, false,
                     dipped(points, "graded plane", coarse)});
  }
}

Points scattered_points(int count, double half_mm, std::uint64_t seed) {
  Random random(seed);
  const auto length = [&] { return random.uniform(-half_mm, half_mm); };
  Points points;
  for (int i = 0; i < count; ++i) points.push_back(Vec3{length(), length(), length()});
  return points;
}

void add_degenerate(std::vector<StressCase>& cases) {
  const auto add = [&](const char* name, const char* text, std::function<Points()> points, bool quick = false,
                       double out_mm = 5.0, double clear_mm = 4.0) {
    cases.push_back(
        {name, "degenerate", text, quick, false, crossed(std::move(points), name, out_mm, clear_mm)});
  };
  add(
      "one-point", "A cloud of one point.",
      [] {
        return Points{{0.05, 0.03, 0}};
      },
      true);
  add(
      "two-points", "Two points.",
      [] {
        return Points{{0, 0, 0}, {0.5, 0.4, 0}};
      },
      true, 8.0, 6.0);
  add(
      "two-points-ulp", "Two points one rounding unit apart.",
      [] {
        return Points{{1, 0, 0}, {std::nextafter(1.0, 2.0), 0, 0}, {0, 0, 0}};
      },
      false, 8.0, 6.0);
  add(
      "collinear", "A hundred points on a line.",
      [] {
        Points points;
        for (int i = -50; i < 50; ++i) points.emplace_back(0.1 * i, 0.05 * i, 0.0);
        return points;
      },
      true);
  add("collinear-steep", "A hundred points on a line that the probe follows.", [] {
    Points points;
    for (int i = -50; i < 50; ++i) points.emplace_back(0.05, 0.03, 0.02 * i);
    return points;
  });
  add(
      "duplicates-only", "A thousand points at one place.",
      [] {
        return Points(1000, {0.05, 0.03, 0});
      },
      true);
  add(
      "duplicates-two-places", "A thousand points at two places.",
      [] {
        Points points(500, {0.05, 0.03, 0});
        points.insert(points.end(), 500, {0.4, 0.3, 0});
        return points;
      },
      false, 8.0, 6.0);
  add(
      "every-point-thrice", "A plane whose every point is there three times.",
      [] {
        Points points = lattice(20, 0.25), all;
        for (const Vec3& p : points) all.insert(all.end(), 3, p);
        return all;
      },
      true);
  add(
      "coplanar-scattered", "Points scattered in a plane.",
      [] {
        Points points = scattered_points(2000, 5.0, 5);
        for (Vec3& p : points) p.z() = 0.0;
        return points;
      },
      false, 9.0, 7.0);
  add(
      "eight-points", "A cube's corners.",
      [] {
        Points points;
        for (int i = 0; i < 8; ++i) points.emplace_back(i & 1, i >> 1 & 1, -(i >> 2 & 1));
        return points;
      },
      true, 12.0, 9.0);
  add(
      "volume", "Points scattered in a volume: no surface at all.",
      [] { return scattered_points(3000, 5.0, 9); }, false, 14.0, 11.0);
  add(
      "coincident-sheets", "Two thousand sheets at one place.",
      [] {
        Points points;
        for (int sheet = 0; sheet < 2000; ++sheet) {
          const Points one = lattice(3, 0.5);
          points.insert(points.end(), one.begin(), one.end());
        }
        return points;
      },
      true);
  add("sheets-ulp-apart", "A thousand sheets, each one rounding unit of single precision above the other.",
      [] {
        Points points;
        float z = 0.5f;
        for (int sheet = 0; sheet < 1000; ++sheet, z = std::nextafter(z, 1.0f)) {
          const Points one = lattice(3, 0.5, static_cast<double>(z) - 0.5);
          points.insert(points.end(), one.begin(), one.end());
        }
        return points;
      });
}

/// A plane with one distant outlier.
void add_strays(std::vector<StressCase>& cases) {
  const auto with_stray = [](const Vec3& stray) {
    return [stray] {
      Points points = lattice(20, 0.5);
      points.push_back(stray);
      return points;
    };
  };
  Dip way{{-3.1, 1.2, 0}, {3.3, 0.8, 0}};
  way.out_mm = 6.0;
  way.clear_mm = 5.0;
  cases.push_back({"stray-100mm", "spacing", "A plane and one stray point 100 mm above its border.", true,
                   false, dipped(with_stray({40, 40, 80}), "a plane and a stray point", way)});
  cases.push_back({"stray-1e6mm", "spacing", "A plane and one stray point a kilometre off.", true, false,
                   dipped(with_stray({1e6, 2e5, 3e5}), "a plane and a far point", way)});
}

}  // namespace

void add_cloud_cases(std::vector<StressCase>& cases) {
  add_spacings(cases);
  add_strays(cases);
  add_degenerate(cases);
}

}  // namespace palpate::experiments
