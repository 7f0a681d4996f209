#include "experiments/benchmarks/felt_surface/plain_god.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "toolkit/core/clock.h"
#include "toolkit/core/try.h"
#include "toolkit/stars/pierce.h"
#include "toolkit/stars/star_tree.h"
#include "toolkit/stars/star_walk.h"

namespace palpate::felt {
namespace {

using render::Frame;

/// The nearest triangle is looked for within so many of the longest edge of the one that was nearest, and at
/// first of the model's longest side over the root of its points.
constexpr double kLookEdges = 2.0;
/// A god object that is forgotten is looked for from so far in front of where it was.
constexpr double kAboveMm = 0.2;
/// Times a frame may leave one sheet and meet another, as of `cloud`.
constexpr int kFlights = 4;

class PlainGod final : public render::HapticRenderer {
 public:
  explicit PlainGod(const PlainRules& rules) : rules_(rules) {}

  Result<render::Decisions> decide(const render::SceneInput&, const render::PrepareContext&) const override {
    return render::Decisions{};
  }
  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override {
    if (scene.models.size() != 1) return Error{"a plain god object feels one model", "give one", {}, 0};
    const render::ModelInput& model = scene.models.front();
    const Stopwatch watch;
    mesh_ = stars::StarMesh::build(*model.cloud, context.threads);
    tree_ = stars::StarTree::build(mesh_, context.threads);
    stiffness_ = model.surface.stiffness_n_per_mm;
    const double extent = model.cloud->box_mm().extent_mm().maxCoeff();
    reach_ = kLookEdges * extent / std::sqrt(static_cast<double>(mesh_.size()));
    render::PrepareReport report;
    report.total_ms = watch.ms();
    report.bytes = mesh_.bytes();
    return report;
  }
  void restart(const Vec3& hip_mm, double) noexcept override { let_go(hip_mm); }
  void let_go(const Vec3& hip_mm) noexcept override {
    contact_ = false;
    from_ = hip_mm - mesh_.origin_mm();
    was_ = 0.0;
  }
  Frame step(const Vec3& hip_mm, double) noexcept override {
    const Vec3 h = hip_mm - mesh_.origin_mm();
    for (int flight = 0; flight < kFlights; ++flight) {
      if (!contact_ && !(rules_.segment ? entered(h) : side_changed(h))) break;
      if (follow(h)) break;
      contact_ = false;
      from_ = stand_.foot.point;
      was_ = 0.0;
    }
    Frame frame;
    frame.contact = contact_;
    frame.god_object_mm = contact_ ? Vec3(stand_.foot.point + mesh_.origin_mm()) : hip_mm;
    frame.force_n = stiffness_ * (frame.god_object_mm - hip_mm);
    frame.model = contact_ ? 0 : -1;
    if (!contact_) from_ = h;
    return frame;
  }
  render::FrameCounters counters() const noexcept override { return {}; }
  render::Description describe() const override {
    return {"plain", "a god object on stars, for ablation", "ours", "unbounded: a benchmark's", {}};
  }

 private:
  [[nodiscard]] bool is_free(std::uint32_t place, double side) const noexcept {
    return !mesh_.is_closed(place) || side > 0.0;
  }
  [[nodiscard]] bool left_just_now(std::uint32_t a, std::uint32_t b, std::uint32_t c) const noexcept {
    const auto& place = stand_.facet.place;
    return from_ == stand_.foot.point && std::array<std::uint32_t, 3>{a, b, c} == place;
  }
  bool entered(const Vec3& h) noexcept {
    stars::Hit hit;
    std::uint32_t tested = 0;
    const geometry::Aabb around{from_.cwiseMin(h), from_.cwiseMax(h)};
    const stars::Way way{from_, h, stars::FloatBox::around(around)};
    for_blocks(around, [&](std::uint32_t block) {
      stars::pierce_block(mesh_, tree_, block, way, hit, tested,
                          [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, double side) noexcept {
                            return is_free(a, side) && !left_just_now(a, b, c);
                          });
    });
    if (hit.place[0] == stars::kNoPlace) return false;
    stand_.facet = stars::Facet(mesh_, hit.place[0], hit.place[1], hit.place[2]);
    side_ = hit.side;
    return contact_ = true;
  }
  /// Of the nearest triangle within reach.
  bool side_changed(const Vec3& h) noexcept {
    stars::Stand nearest;
    const Vec3 reach = Vec3::Constant(reach_);
    for_blocks({h - reach, h + reach}, [&](std::uint32_t block) {
      const std::uint32_t first = block * stars::kBlockPlaces;
      for (std::uint32_t p = first; p < std::min(first + stars::kBlockPlaces, mesh_.size()); ++p)
        mesh_.for_triangles_of(p, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
          const stars::Facet facet(mesh_, a, b, c);
          const stars::Foot foot = foot_on(facet, h);
          if (foot.distance_sq < nearest.foot.distance_sq) nearest = {facet, foot};
        });
    });
    const bool near =
        nearest.facet.place[0] != stars::kNoPlace && nearest.foot.distance_sq <= reach_ * reach_;
    const double side = near ? std::copysign(1.0, height(nearest, h)) : 0.0;
    const double was = std::exchange(was_, side);
    if (!near || was * side >= 0.0 || !is_free(nearest.facet.place[0], was)) return false;
    stand_ = nearest;
    side_ = was;
    return contact_ = true;
  }
  [[nodiscard]] double height(const stars::Stand& stand, const Vec3& h) const noexcept {
    return rules_.pseudonormal ? side_of(mesh_, stand, h).height
                               : stand.facet.area_normal().dot(h - stand.foot.point);
  }
  bool follow(const Vec3& h) noexcept {
    int moves = std::numeric_limits<int>::max();
    static_cast<void>(descend(mesh_, h, stand_, moves));
    if (side_ * height(stand_, h) > 0.0) return false;
    return !side_of(mesh_, stand_, h).border ||
           past_border_sq(stand_, stand_.facet.area_normal(), h) <= stand_.facet.longest_edge_sq();
  }
  template <class Use>
  void for_blocks(const geometry::Aabb& box, Use&& use) const noexcept {
    static_cast<void>(
        tree_.for_blocks(box, std::numeric_limits<std::uint32_t>::max(),
                         [&](std::uint32_t block, const stars::BoxNode&, std::uint32_t) noexcept {
                           use(block);
                           return true;
                         }));
  }

  PlainRules rules_;
  stars::StarMesh mesh_;
  stars::StarTree tree_;
  double stiffness_ = 0.0, reach_ = 0.0;
  bool contact_ = false;
  double side_ = 1.0;  ///< where the HIP came from
  double was_ = 0.0;   ///< side of the nearest triangle in the last frame; 0: none was near
  stars::Stand stand_;
  Vec3 from_ = Vec3::Zero();  ///< free up to here
};

class Forgetful final : public render::HapticRenderer {
 public:
  explicit Forgetful(std::unique_ptr<render::HapticRenderer> renderer) : renderer_(std::move(renderer)) {}

  Result<render::Decisions> decide(const render::SceneInput& scene,
                                   const render::PrepareContext& context) const override {
    return renderer_->decide(scene, context);
  }
  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override {
    return renderer_->prepare(scene, context);
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    renderer_->restart(hip_mm, t_s);
    held_ = false;
  }
  void let_go(const Vec3& hip_mm) noexcept override {
    renderer_->let_go(hip_mm);
    held_ = false;
  }
  Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    if (held_) renderer_->let_go(above_);
    const Frame frame = renderer_->step(hip_mm, t_s);
    const Vec3 up = frame.god_object_mm - hip_mm;
    held_ = frame.contact && up != Vec3::Zero();
    if (held_) above_ = frame.god_object_mm + kAboveMm * up.normalized();
    return frame;
  }
  render::FrameCounters counters() const noexcept override { return renderer_->counters(); }
  render::Description describe() const override { return renderer_->describe(); }

 private:
  std::unique_ptr<render::HapticRenderer> renderer_;
  bool held_ = false;
  Vec3 above_ = Vec3::Zero();
};

}  // namespace

std::unique_ptr<render::HapticRenderer> make_plain_god(const PlainRules& rules) {
  return std::make_unique<PlainGod>(rules);
}

std::unique_ptr<render::HapticRenderer> make_forgetful(std::unique_ptr<render::HapticRenderer> renderer) {
  return std::make_unique<Forgetful>(std::move(renderer));
}

}  // namespace palpate::felt
