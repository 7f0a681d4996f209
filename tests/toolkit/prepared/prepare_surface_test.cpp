// Surfaces made region by region: the same bytes as in one piece, gone on with after a kill.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "tests/toolkit/prepared/prepared_points.h"
#include "toolkit/prepared/prepare.h"
#include "toolkit/spline_sdf/prepared_surface.h"

namespace palpate::prepared::test {
namespace {

using palpate::test::value_of;

/// Long shapes, so that few points are around a region. Spacing 1, times `scale`.
using Shape = std::vector<Vec3> (*)(double scale);

/// An open sheet with noise.
std::vector<Vec3> strip(double scale) {
  Random random(3);
  std::vector<Vec3> points;
  for (int i = 0; i < 64000; ++i) {
    const double x = random.uniform(0.0, 1600.0), y = random.uniform(0.0, 40.0);
    points.push_back(scale *
                     Vec3(x, y, 6.0 * std::sin(x / 25.0) * std::cos(y / 20.0) + 0.1 * random.normal()));
  }
  return points;
}

/// The same over a crest and a trough: from one most ways are free above, from the other below.
std::vector<Vec3> crest_and_trough(double scale) {
  Random random(7);
  std::vector<Vec3> points;
  for (int i = 0; i < 64000; ++i) {
    const double x = random.uniform(0.0, 1600.0), y = random.uniform(0.0, 40.0);
    points.push_back(scale * Vec3(x, y, 200.0 * std::sin(x / 250.0) + 0.1 * random.normal()));
  }
  return points;
}

/// The same, so long that a sixteenth of the points is more than kMostPoints.
std::vector<Vec3> ribbon() {
  Random random(6);
  std::vector<Vec3> points;
  for (int i = 0; i < 520000; ++i) {
    const double x = random.uniform(0.0, 26000.0), y = random.uniform(0.0, 20.0);
    points.emplace_back(x, y, 6.0 * std::sin(x / 60.0) + 0.1 * random.normal());
  }
  return points;
}

constexpr double kPipeLength = 1000.0, kPipeRadius = 8.0;
/// Closed, bent, without noise.
std::vector<Vec3> pipe(double scale) {
  Random random(4);
  std::vector<Vec3> points;
  const double share_of_ends = 2.0 * kPipeRadius / (kPipeLength + 2.0 * kPipeRadius);
  for (int i = 0; i < 50000; ++i) {
    const double a = random.uniform(0.0, 2.0 * std::numbers::pi);
    Vec3 p(random.uniform(0.0, kPipeLength), kPipeRadius * std::cos(a), kPipeRadius * std::sin(a));
    if (random.uniform() < share_of_ends) {  // half a ball on either end
      const double along = random.uniform(-1.0, 1.0), across = std::sqrt(1.0 - along * along);
      p = kPipeRadius * Vec3(along, across * std::cos(a), across * std::sin(a));
      if (along > 0.0) p.x() += kPipeLength;
    }
    points.push_back(scale * (p + Vec3(0.0, 0.0, 20.0 * std::sin(p.x() / 150.0))));
  }
  return points;
}

/// A closed plank: planes that meet at edges, and faces that do not see each other.
std::vector<Vec3> plank(double scale) {
  Random random(5);
  const Vec3 sides(1000.0, 24.0, 12.0);
  std::vector<Vec3> points;
  for (int axis = 0; axis < 3; ++axis)
    for (int face = 0; face < 2; ++face) {
      const double area = sides.prod() / sides[axis];
      for (int i = 0; i < static_cast<int>(area); ++i) {
        Vec3 p(random.uniform(0.0, sides.x()), random.uniform(0.0, sides.y()),
               random.uniform(0.0, sides.z()));
        p[axis] = face * sides[axis];
        points.push_back(scale * (p + 0.03 * Vec3(random.normal(), random.normal(), random.normal())));
      }
    }
  return points;
}

/// Views of a pipe from six sides, merged: each has its own noise and is off by its own error, covers a third
/// of the way around, so that two overlap everywhere, and leaves strays off the surface.
std::vector<Vec3> merged_views(double scale) {
  Random random(9);
  constexpr int kViews = 6, kPointsOfView = 14000;
  constexpr double kStrays = 0.05, kFarthestStray = 4.0;
  std::vector<Vec3> points;
  for (int view = 0; view < kViews; ++view) {
    const double error = 0.3 * random.normal(), noise = random.uniform(0.1, 0.35);
    for (int i = 0; i < kPointsOfView; ++i) {
      const double a = 2.0 * std::numbers::pi * (view + random.uniform(-1.0, 1.0)) / kViews;
      const double r = kPipeRadius + error + noise * random.normal();
      Vec3 p(random.uniform(0.0, kPipeLength), r * std::cos(a), r * std::sin(a));
      if (random.uniform() < kStrays)
        p += kFarthestStray * random.uniform() * Vec3(random.normal(), random.normal(), random.normal());
      points.push_back(scale * (p + Vec3(0.0, 0.0, 20.0 * std::sin(p.x() / 150.0))));
    }
  }
  return points;
}

class PreparedSurface : public Prepared {
 protected:
  static constexpr std::uint64_t kMostPoints = 32000;  // several regions of strip and pipe

  PrepareSurfaceReport make(const std::string& name, std::uint64_t most = UINT64_MAX, int threads = 2) {
    PrepareSurfaceOptions options;
    options.most_chunk_points = most;
    options.threads = threads;
    const CellFile cells = open();
    return value_of(prepare_surface(cells, options, in(name)));
  }
  [[nodiscard]] std::shared_ptr<const spline_sdf::SurfaceFile> surface(const std::string& name) const {
    return value_of(spline_sdf::SurfaceFile::open(in(name)));
  }
};

TEST_F(PreparedSurface, DivisionLeavesNoTrace) {
  const struct {
    Shape shape;
    double scale;
    std::uint64_t most;
    std::size_t closed;
  } kinds[] = {{strip, 1.0, kMostPoints, 0},
               {crest_and_trough, 1.0, kMostPoints, 0},
               {pipe, 1e-3, kMostPoints, 1},
               {plank, 250.0, kMostPoints + kMostPoints / 2, 1},
               {merged_views, 1.0, 2 * kMostPoints, 1}};
  for (const auto& kind : kinds) {
    static_cast<void>(prepare(kind.shape(kind.scale), {}));
    EXPECT_EQ(make("whole").chunks, 1u);
    const PrepareSurfaceReport divided = make("divided", kind.most, 1);
    EXPECT_GE(divided.chunks, 3u);
    EXPECT_EQ(divided.contradicted, 0.0);
    EXPECT_TRUE(bytes("divided") == bytes("whole"));
    const auto file = surface("divided");
    EXPECT_EQ(file->surfaces().front().surface.grid.closed_components.size(), kind.closed);
    EXPECT_EQ(names(), (std::set<std::string>{"cells", "divided", "whole"}));
  }
}

TEST_F(PreparedSurface, ACoarserOneThatDoesNotFitIsMadeByRegionsToo) {
  static_cast<void>(prepare(ribbon(), {}));
  EXPECT_EQ(make("whole").chunks, 1u);
  EXPECT_GE(make("divided", kMostPoints).chunks, 16u);
  const auto whole = surface("whole"), divided = surface("divided");
  ASSERT_GE(divided->surfaces().size(), 2u);
  const spline_sdf::StoredSurface &in_memory = whole->surfaces()[1], &by_regions = divided->surfaces()[1];
  EXPECT_EQ(by_regions.surface.spacing_mm, in_memory.surface.spacing_mm);
  EXPECT_EQ(by_regions.surface.noise_mm, in_memory.surface.noise_mm);
  // Blocks that patches are fitted in differ: the same surface but for that.
  const auto rms_mm = [&](const spline_sdf::SurfaceFile& file) {
    spline_sdf::SampleDistances distances;
    const auto loaded = value_of(file.load(1));
    spline_sdf::add_distances(loaded->grid, *whole->sample(), nullptr, distances);
    return distances.rms_voxels() * loaded->grid.voxel_mm;
  };
  EXPECT_NEAR(rms_mm(*divided), rms_mm(*whole), 0.01 * rms_mm(*whole));
  EXPECT_NEAR(static_cast<double>(by_regions.tile_bytes), static_cast<double>(in_memory.tile_bytes),
              0.02 * static_cast<double>(in_memory.tile_bytes));
  EXPECT_EQ(names(), (std::set<std::string>{"cells", "divided", "whole"}));
}

class StoppedSurface : public PreparedSurface {
 protected:
  /// True if it died.
  bool die_at(int report) {
    const pid_t child = ::fork();
    if (child == 0) {
      Death death(report);
      PrepareSurfaceOptions options;
      options.most_chunk_points = kMostPoints;
      options.threads = 1;  // no thread of another process
      const CellFile cells = open();
      ::_exit(prepare_surface(cells, options, in("divided"), death).ok() ? 0 : 1);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) != 1);
    return WEXITSTATUS(status) == 9;
  }
};

TEST_F(StoppedSurface, GoesOnAfterTheLastWholeChunk) {
  static_cast<void>(prepare(pipe(1.0), {}));
  const std::uint64_t chunks = make("whole", kMostPoints, 1).chunks;
  ASSERT_GE(chunks, 3u);
  ASSERT_TRUE(die_at(3)) << "two chunks were made";
  EXPECT_FALSE(std::filesystem::exists(in("divided")));
  // A record half written is none.
  const std::string part = in("divided.chunks");
  std::filesystem::resize_file(part, std::filesystem::file_size(part) - 5);
  EXPECT_EQ(make("divided", kMostPoints, 1).resumed, 1u);
  EXPECT_TRUE(bytes("divided") == bytes("whole"));
  std::filesystem::remove(in("divided"));
  // Other regions are begun anew.
  ASSERT_TRUE(die_at(3));
  EXPECT_EQ(make("divided").resumed, 0u);
  EXPECT_TRUE(bytes("divided") == bytes("whole"));
}

TEST_F(PreparedSurface, RefusesWhatItCannotMake) {
  static_cast<void>(prepare(pipe(1.0), {}));
  PrepareSurfaceOptions options;
  options.most_chunk_points = 3000;
  EXPECT_TRUE(palpate::test::refused(prepare_surface(open(), options, in("a")), "memory"));
  std::vector<Vec3> wide = pipe(1.0);
  wide.emplace_back(1e8, 0.0, 0.0);
  static_cast<void>(prepare(wide, {}));
  EXPECT_TRUE(palpate::test::refused(prepare_surface(open(), {}, in("a")), "prepare the scan in parts"));
  EXPECT_FALSE(std::filesystem::exists(in("a")));
}

}  // namespace
}  // namespace palpate::prepared::test
