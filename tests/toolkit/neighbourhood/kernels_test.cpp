// The inner loops that a processor may have in wider registers, against the portable ones.
#include "toolkit/neighbourhood/knn_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "toolkit/core/random.h"

namespace palpate::neighbourhood {
namespace {

struct Sample {
  Candidates candidates;
  std::vector<Vec3> points;  ///< the same, for the tests' own sums
  std::uint32_t self = 0;
};

/// n candidates in [-size, size]^3, most of them on a lattice so that distances tie; indices in no order.
Sample sample(std::size_t n, double size, Random& random) {
  Sample s;
  s.candidates.make_room(n);
  std::vector<std::uint32_t> index(n);
  for (std::size_t i = 0; i < n; ++i) index[i] = static_cast<std::uint32_t>(i * 2654435761u);
  for (std::size_t i = 0; i < n; ++i) {
    Vec3 p(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    if (i % 4 != 0) p = (p * 4.0).array().round() / 4.0;
    s.candidates.x[i] = static_cast<float>(size * p.x());
    s.candidates.y[i] = static_cast<float>(size * p.y());
    s.candidates.z[i] = static_cast<float>(size * p.z());
    s.candidates.index[i] = index[i];
    s.points.emplace_back(static_cast<double>(s.candidates.x[i]), static_cast<double>(s.candidates.y[i]),
                          static_cast<double>(s.candidates.z[i]));
  }
  s.candidates.close(n);
  s.self = index[n / 2];
  return s;
}

double square(const Vec3& a, const Vec3& b) {
  const Vec3 d = a - b;
  return d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
}

/// From where squares of floats vanish to where they overflow.
constexpr double kSizes[] = {1e-41, 1e-24, 1e-19, 1.0, 1e6, 1e19, 3e38};

std::vector<std::uint32_t> kept_of(const Scratch& scratch) {
  return {scratch.index.data(), scratch.index.data() + scratch.count};
}

TEST(Kernels, SievesLoseNothingAndMeasureExactly) {
  Random random(21);
  for (const Kernels* kernel : {&portable_kernels(), &kernels()})
    for (const double size : kSizes)
      for (const std::size_t n : {1u, 7u, 8u, 9u, 64u, 133u}) {
        const Sample s = sample(n, size, random);
        const Vec3 p = s.points[n / 2];
        Scratch scratch;
        for (const Vec3& edge : s.points) {
          // The limit is the exact distance of some candidate: the hardest to keep.
          const double ball = square(edge, p), cube = (edge - p).cwiseAbs().maxCoeff();
          kernel->keep_ball(s.candidates, p, ball, scratch);
          std::vector<std::uint32_t> kept = kept_of(scratch);
          for (std::size_t i = 0; i < n; ++i)
            ASSERT_TRUE(square(s.points[i], p) > ball ||
                        std::find(kept.begin(), kept.end(), s.candidates.index[i]) != kept.end())
                << size;
          kernel->keep_cube(s.candidates, p, cube, scratch);
          kept = kept_of(scratch);
          std::size_t at = 0, outer = 0, inner = 0;
          for (std::size_t i = 0; i < n; ++i) {
            const double along = (s.points[i] - p).cwiseAbs().maxCoeff();
            outer += along <= cube;
            inner += along <= 0.5 * cube;
            if (at == kept.size() || kept[at] != s.candidates.index[i]) {
              ASSERT_GT(along, cube);
              continue;
            }
            ASSERT_EQ(scratch.along[at], along);
            ASSERT_EQ(scratch.square[at], square(s.points[i], p));
            ++at;
          }
          ASSERT_EQ(at, kept.size());
          const Held held = kernel->count_in_cubes(scratch, cube, 0.5 * cube);
          ASSERT_EQ(held.outer, outer);
          ASSERT_EQ(held.inner, inner);
        }
      }
}

TEST(Kernels, ASieveOfAFewKeepsFew) {
  Random random(22);
  const Sample s = sample(1000, 1.0, random);
  for (const Kernels* kernel : {&portable_kernels(), &kernels()}) {
    Scratch scratch;
    kernel->keep_ball(s.candidates, s.points[0], 0.0, scratch);
    std::size_t same = 0;
    for (const Vec3& p : s.points) same += p == s.points[0];
    EXPECT_EQ(scratch.count, same);
  }
}

TEST(Kernels, ChooseTheEightFirstByDistanceAndIndex) {
  Random random(23);
  for (const Kernels* kernel : {&portable_kernels(), &kernels()})
    for (const double size : kSizes)
      for (const std::size_t n : {1u, 2u, 8u, 9u, 10u, 12u, 13u, 16u, 23u, 24u, 25u, 60u})
        for (const double share : {0.0, 0.3, 2.0}) {
          const Sample s = sample(n, size, random);
          const Vec3 p = s.points[n / 2];
          Scratch scratch;
          kernel->keep_cube(s.candidates, p, kEverything, scratch);
          ASSERT_EQ(scratch.count, n);
          kernel->leave_out(scratch, share * size);
          std::vector<std::pair<double, std::uint32_t>> expected;
          for (std::size_t i = 0; i < n; ++i)
            if ((s.points[i] - p).cwiseAbs().maxCoeff() <= share * size && s.candidates.index[i] != s.self)
              expected.emplace_back(square(s.points[i], p), s.candidates.index[i]);
          std::sort(expected.begin(), expected.end());
          Neighbours out;
          const double worst = kernel->choose_eight(s.self, scratch, out);
          ASSERT_EQ(worst, expected.size() < kNeighbours ? kEverything : expected[kNeighbours - 1].first);
          for (std::size_t k = 0; k < kNeighbours; ++k)
            ASSERT_EQ(out[k], k < expected.size() ? expected[k].second : s.self) << n << " place " << k;
        }
}

}  // namespace
}  // namespace palpate::neighbourhood
