// `cloud-literal` against the thesis's figures, written down once more the obvious slow way.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/partition/morton_order.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/trace/replay.h"

namespace palpate::render {
namespace {

constexpr double kLiteralStiffness = 0.5;  // N/mm, a model's own

/// Figures 36 and 42 and section 3.5.2 over all points of one model without a pose, unshaded.
class Printed {
 public:
  Printed(const SceneInput& scene, double box_mm, double cell_mm)
      : cloud_(*scene.models[0].cloud),
        table_(neighbourhood::build_neighbours("modified-knn:complete=false", cloud_, 1).value().table),
        half_(0.5 * box_mm),
        cell_(cell_mm),
        friction_(scene.models[0].surface.friction.static_coefficient) {
    low_ = partition::local_box(cloud_, 1).low_mm;
  }

  Frame step(const Vec3& hip) {
    const Vec3 h = hip - cloud_.origin_mm, before = std::exchange(last_, h);
    std::uint32_t from = god_;
    bool collided = was_collision_;
    if (was_collision_) {
      collided = !crosses(before, h) || crosses(h, at(god_) + radius() * direction_);
    } else if (const auto crossed = crossed_by(before, h); !crossed.empty()) {
      collided = true;
      from = crossed.front();
      for (const std::uint32_t i : crossed)
        if ((at(i) - before).norm() < (at(from) - before).norm()) from = i;
    }
    Frame frame;
    frame.god_object_mm = hip;
    frame.contact = collided;
    if (collided) {
      const std::uint32_t free = nearest_along(from, h, [](std::uint32_t) { return true; });
      const std::uint32_t rolled = friction_ > 0.0 && was_collision_ ? rolled_back(free, h) : free;
      rolls_ += rolled != free;
      god_ = rolled;
      direction_ = (at(god_) - h).normalized();
      frame.god_object_mm = at(god_) + cloud_.origin_mm;
      frame.force_n = kLiteralStiffness * (at(god_) - h);
    }
    was_collision_ = collided;
    return frame;
  }
  void start(const Vec3& hip) { last_ = hip - cloud_.origin_mm; }
  [[nodiscard]] std::size_t rolls() const { return rolls_; }

 private:
  [[nodiscard]] Vec3 at(std::size_t i) const { return cloud_.local_mm(i); }
  [[nodiscard]] double radius() const { return std::sqrt(3.0) * half_ * (1.0 + 1e-3); }
  [[nodiscard]] Vec3 cell_of(const Vec3& p) const { return ((p - low_) / cell_).array().floor(); }

  /// Section 3.1.3: the cells of the starting points of pieces at most a cell long, and of the end; the boxes
  /// of their points.
  [[nodiscard]] std::vector<std::uint32_t> crossed_by(const Vec3& a, const Vec3& b) const {
    const double pieces = std::max(1.0, std::ceil((b - a).norm() / cell_));
    std::vector<Vec3> cells = {cell_of(b)};
    for (double i = 0; i < pieces; ++i) cells.push_back(cell_of(a + (i / pieces) * (b - a)));
    std::vector<std::uint32_t> crossed;
    for (std::uint32_t i = 0; i < cloud_.size(); ++i)
      if (std::find(cells.begin(), cells.end(), cell_of(at(i))) != cells.end() && in_box(a, b, at(i)))
        crossed.push_back(i);
    return crossed;
  }
  [[nodiscard]] bool crosses(const Vec3& a, const Vec3& b) const { return !crossed_by(a, b).empty(); }
  [[nodiscard]] bool in_box(const Vec3& a, const Vec3& b, const Vec3& centre) const {
    double t0 = 0.0, t1 = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double d = b[axis] - a[axis];
      double s = (centre[axis] - half_ - a[axis]) / d, e = (centre[axis] + half_ - a[axis]) / d;
      if (s > e) std::swap(s, e);
      t0 = std::max(t0, s);
      t1 = std::min(t1, e);
    }
    return t0 <= t1;
  }
  /// Downhill in the distance to `aim` from neighbour to neighbour, as long as `may` allows the next.
  template <class May>
  [[nodiscard]] std::uint32_t nearest_along(std::uint32_t i, const Vec3& aim, May&& may) const {
    while (true) {
      std::uint32_t best = i;
      for (const std::uint32_t other : table_.of[i])
        if ((at(other) - aim).norm() < (at(best) - aim).norm()) best = other;
      if (best == i || !may(best)) return i;
      i = best;
    }
  }
  /// Towards the god object of the frame before, no further than the coefficient times the depth.
  [[nodiscard]] std::uint32_t rolled_back(std::uint32_t free, const Vec3& h) const {
    const double most = friction_ * (at(free) - h).norm();
    return nearest_along(free, at(god_), [&](std::uint32_t i) { return (at(i) - at(free)).norm() <= most; });
  }

  const cloud::Cloud& cloud_;
  neighbourhood::NeighbourTable table_;
  double half_, cell_, friction_;
  Vec3 low_ = Vec3::Zero(), last_ = Vec3::Zero(), direction_ = Vec3::UnitZ();
  std::uint32_t god_ = 0;
  bool was_collision_ = false;
  std::size_t rolls_ = 0;
};

TEST(CloudLiteral, FollowsTheFiguresToTheLetter) {
  for (const char* spec : {"sinusoid:points=2601:extent_mm=40:wavelength_mm=20:amplitude_mm=3:jitter=0.3",
                           "wedge:points=2601:extent_mm=40:jitter=0.3"})
    for (const double friction : {0.0, 0.8})
      for (const char* path_spec : {"weave:frames=4000:depth_mm=1.5:speed_mm_s=60",
                                    "weave:frames=1500:depth_mm=2.5:period_frames=90:speed_mm_s=900"}) {
        SCOPED_TRACE(testing::Message() << spec << ", friction " << friction << ", " << path_spec);
        Scene scene = generated(spec);
        scene.input.models[0].surface.friction = {friction, friction};
        ASSERT_EQ(scene.input.models[0].surface.stiffness_n_per_mm, kLiteralStiffness);
        // Small cells and boxes, so that segments span several and gaps are met.
        const auto renderer = prepared(
            scene.input,
            "cloud-literal:shading=none:neighbours=modified-knn:box_mm=0.7:resolution_mm=0.5:cell=2");
        Printed printed(scene.input, 0.7, 1.0);
        const trace::ProbePath path = path_over(scene, path_spec);
        renderer->restart(path.hip_mm[0]);
        printed.start(path.hip_mm[0]);
        std::size_t contacts = 0;
        for (std::size_t i = 0; i < path.size(); ++i) {
          const Frame a = renderer->step(path.hip_mm[i], 1e-3), b = printed.step(path.hip_mm[i]);
          ASSERT_EQ(a.contact, b.contact) << i;
          // The same point, but for the rounding of the way to the world and back.
          ASSERT_LT((a.god_object_mm - b.god_object_mm).norm(), 1e-12) << i;
          ASSERT_LT((a.force_n - b.force_n).norm(), 1e-12) << i;
          contacts += a.contact;
        }
        EXPECT_GT(contacts, path.size() / 4);
        EXPECT_LT(contacts, path.size());
        EXPECT_EQ(printed.rolls() > 0, friction > 0.0);
      }
}

// Section 3.2.2.5 returns what the shrinking block holds: with the option, eight.
TEST(CloudLiteral, TakesTheNeighboursThatThePrintedSearchFinds) {
  const Scene scene = generated("sinusoid:points=2601:jitter=0.4");
  const trace::ProbePath path = path_over(scene, "weave:frames=3000");
  const auto hash = [&](const std::string& options) {
    const auto renderer = prepared(scene.input, "cloud-literal:neighbours=modified-knn" + options);
    return trace_hash(trace::replay(*renderer, path).value());
  };
  EXPECT_EQ(hash(""), hash(":complete=false"));
  EXPECT_NE(hash(""), hash(":complete=true"));

  Registry registry;
  register_toolkit_renderers(registry);
  for (const auto& [name, fewer] : {std::pair("cloud-literal", true), std::pair("cloud", false)}) {
    Options options;
    options.set("neighbours", "modified-knn");
    const auto notes = registry.make(name, options).value()->prepare(scene.input, {1, nullptr}).value().notes;
    EXPECT_EQ(std::any_of(notes.begin(), notes.end(),
                          [](const std::string& note) {
                            return note.find("have fewer than eight neighbours") != std::string::npos;
                          }),
              fewer)
        << name;
  }
}

// Cells of 5 mm. The way goes from the cell (0, 0) through a corner of (0, 1) into (1, 1), 5.5 mm: two
// pieces, none of which starts in (0, 1), where the only point on the way lies.
TEST(CloudLiteral, SampledCellsMissAClippedCellThatCrossedCellsFind) {
  std::vector<Vec3> points = {{4.4, 5.05, 0}};
  for (const double x : {0.0, 20.0})
    for (const double y : {0.0, 20.0}) points.emplace_back(x, y, 0);
  const SceneInput scene = cloud_of(points);
  const Vec3 from(3.0, 4.9, 0.0), to(8.5, 5.6, 0.0);
  for (const auto& [cells, found] : {std::pair("sampled", false), std::pair("crossed", true)}) {
    SCOPED_TRACE(cells);
    const auto renderer = prepared(
        scene,
        std::string("cloud-literal:neighbours=exact-knn:shading=none:box_mm=0.4:resolution_mm=1:cells=") +
            cells + (found ? "" : ":count_missed"));
    renderer->restart(from);
    EXPECT_EQ(renderer->step(to, 1e-3).contact, found);
    EXPECT_EQ(renderer->counters().missed_cells, found ? 0u : 1u);
  }
}

// Whatever the distance, and with the cells counted: bounded by the grid.
TEST(CloudLiteral, AHipFromFarAwayCostsNoMoreThanTheGrid) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  for (const char* options : {"", ":count_missed"}) {
    const auto renderer = prepared(scene.input, std::string("cloud-literal") + options);
    for (const double far : {1e3, 1e9, 1e17, 1e200, 1e308}) {
      SCOPED_TRACE(far);
      renderer->restart(Vec3(0.1, 0.2, far));
      const std::uint64_t before = renderer->counters().cells_visited;
      (void)renderer->step(Vec3(0.3, 0.1, -far), 1e-3);
      (void)renderer->step(Vec3(far, 0.1, 0.2), 1e-3);
      EXPECT_LT(renderer->counters().cells_visited - before, 1000u);
    }
  }
}

}  // namespace
}  // namespace palpate::render
