#include "toolkit/render/correction_ramp.h"
#include "toolkit/renderers/renderer_infos.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/geometry/god_object_check.h"
#include "toolkit/heightfield/heightfield_crossing.h"
#include "toolkit/heightfield/heightfield_model.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {
namespace {

/// Newton steps of the fast path. A cell without twist needs one, and one more if the guess was in the next
/// cell.
constexpr int kQuickSolves = 4;
/// Largest remaining error of the last Newton step in cells: 2e-8 mm for posts 0.1 mm apart, a hundredth of
/// the float rounding of heights of 10 mm.
constexpr double kQuickError = 0x1p-22;
/// A step changes the Hessian by at most about this multiple of its twist.
constexpr double kHessianChange = 4.0;
/// The nearest point is never farther than before, except for rounding.
constexpr double kNoFarther = 1.0 + 0x1p-40;
/// Entries that one frame follows: the HIP leaves one flank and meets the next. The rest waits.
constexpr int kMaxEntries = 4;
/// Closer to the next post than to this one.
constexpr double kMiddle = 0.5;
/// A HIP farther away than this, in posts or in mm, is off the field; its cell index would overflow.
constexpr double kFarPosts = 0x1p40;
constexpr double kFarMm = 1e150;

bool is_near(const heightfield::PlanPoint& p) noexcept {
  return std::abs(p.x) < kFarPosts && std::abs(p.y) < kFarPosts && std::abs(p.z) < kFarMm;
}

bool is_beside(std::int32_t a, std::int32_t b) noexcept {
  return static_cast<std::uint32_t>(a - b + 1) <= 2;
}

bool is_share(double s) noexcept {
  return s >= 0.0 && s <= 1.0;
}

/// The local model of `heightfield`.
class HeightFieldSurface {
 public:
  struct Memory {};
  static constexpr bool kTemplatedOnFeatures = true;

  HeightFieldSurface(heightfield::HeightFieldModel model, bool nearest_post)
      : model_(std::move(model)), sheet_(model_.field()), nearest_post_(nearest_post) {}
  HeightFieldSurface(const HeightFieldSurface&) = delete;  // the sheet points into the field
  HeightFieldSurface& operator=(const HeightFieldSurface&) = delete;

  [[nodiscard]] ModelPose& pose() noexcept { return model_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return model_.pose; }
  [[nodiscard]] unsigned features() const noexcept { return model_.surface.features; }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return model_.grid->box_mm; }
  [[nodiscard]] bool touching() const noexcept { return contact_ || spread_.active(); }
  void release_contact(const Vec3& h) noexcept {
    contact_ = false;
    frames_since_check_ = 0;
    spread_.end();
    state_.release();
    started_ = is_finite(h);
    if (started_) start(sheet_.plan(h));
  }
  void release() noexcept { state_.release(); }

  template <unsigned kFeatures>
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept {
    const heightfield::PlanPoint plan = sheet_.plan(h);
    bool held = (contact_ && follow_quickly(plan, counters)) || update(plan, status, counters);
    if (held) contact = contact_at<kFeatures>(h);
    if (held && ++frames_since_check_ >= geometry::kCheckPeriodFrames) [[unlikely]] {
      frames_since_check_ = 0;
      if (correct(plan, h, contact.pull, status, counters)) {
        held = contact_;
        if (held) contact = contact_at<kFeatures>(h);
      }
    }
    if (nearest_post_) return held;  // goes from post to post, as it is defined
    return spread_.answer(h, held, contact, [&] { contact = contact_at<kFeatures>(h); });
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& contact) noexcept {
    return state_.respond<kFeatures>(contact, model_.surface.texture, model_.field().origin_mm);
  }

 private:
  /// The rule of geometry/god_object_check.h: compares the held place with the surface above or below the
  /// HIP. True if that changed it.
  bool correct(const heightfield::PlanPoint& plan, const Vec3& h, const Vec3& pull, FrameStatus& status,
               FrameCounters& counters) noexcept {
    const double far = pull.norm(), spacing = std::min(sheet_.step_x, sheet_.step_y);
    if (!(far > geometry::kAdjacentSpacings * spacing)) return false;
    heightfield::CellPosition under;
    const auto query = [&](const Vec3& place) noexcept -> geometry::NearestSurface {
      const heightfield::PlanPoint at = sheet_.plan(place);
      if (!(at.x >= 0.0 && at.y >= 0.0 && at.x < sheet_.last_column && at.y < sheet_.last_row)) return {};
      under = {static_cast<std::int32_t>(at.x), static_cast<std::int32_t>(at.y), at.x - std::floor(at.x),
               at.y - std::floor(at.y)};
      const heightfield::BilinearPatch patch = sheet_.patch(under.column, under.row);
      const Vec3 normal(-(patch.b + patch.d * under.t) * sheet_.inverse_x,
                        -(patch.c + patch.d * under.s) * sheet_.inverse_y, 1.0);
      const double size = normal.norm();
      return {patch.exists(), (at.z - patch.height(under.s, under.t)) / size, normal / size};
    };
    const Vec3 outward = pull / far;
    switch (geometry::check_god_object(query(h), h, h + pull, outward, outward, spacing,
                                       geometry::kMuchNearerShare, query)) {
      case geometry::GodObjectVerdict::kKeep:
        return false;
      case geometry::GodObjectVerdict::kMove: {
        int moves = heightfield::kMaxDescentMoves;
        (void)query(h);
        position_ = under;
        (void)stay(plan, moves, status, counters);
        return true;
      }
      case geometry::GodObjectVerdict::kFree:
        break;
    }
    contact_ = false;
    tested_to_ = plan;
    side_ = heightfield::SheetSide::kAbove;
    return true;
  }

  void start(const heightfield::PlanPoint& h) noexcept {
    tested_to_ = h;
    side_ = is_near(h) ? heightfield::side_of(sheet_, h) : heightfield::SheetSide::kNowhere;
  }

  /// The fast path for most contact frames: moves the god object with the HIP and corrects it by one or two
  /// Newton steps. False, with nothing changed, if it left the neighbouring cells, a crease or rim holds it,
  /// the distance is not convex, or it came out.
  [[gnu::always_inline]] bool follow_quickly(const heightfield::PlanPoint& h,
                                             FrameCounters& counters) noexcept {
    // Extrapolates the vector from the HIP to the god object by its last change.
    double x = h.x + lead_x_ + turn_x_, y = h.y + lead_y_ + turn_y_;
    const double enough = kQuickError * std::min(sheet_.x_sq, sheet_.y_sq);
    std::int32_t last_column = -1, last_row = -1;
    for (int solve = 0; solve < kQuickSolves; ++solve) {
      if (!(x >= 0.0 && y >= 0.0 && x < sheet_.last_column && y < sheet_.last_row)) return false;
      const auto column = static_cast<std::int32_t>(x), row = static_cast<std::int32_t>(y);
      if (!is_beside(column, position_.column) || !is_beside(row, position_.row)) return false;
      // Oscillation: a crease holds the god object.
      if (column == last_column && row == last_row) return false;
      const heightfield::BilinearPatch patch = sheet_.patch(column, row);
      const double hs = h.x - column, ht = h.y - row;
      double s = x - column, t = y - row;
      const heightfield::DistanceDerivatives jet(sheet_, patch, s, t, hs, ht, h.z);
      const double det = jet.determinant();
      if (!(det > 0.0)) return false;  // also false over holes
      const double scale = 1.0 / det;
      const double ds = (jet.hst * jet.gt - jet.htt * jet.gs) * scale;
      const double dt = (jet.hst * jet.gs - jet.hss * jet.gt) * scale;
      s += ds;
      t += dt;
      if (is_share(s) && is_share(t)) {
        // The step's remaining gradient comes from the twist; the Hessian is at least about a step squared.
        const double twist = std::abs(patch.d) * (std::abs(jet.zs) + std::abs(jet.zt));
        const double size = std::abs(ds) + std::abs(dt);
        if (twist * (size * size) <= enough) return accept({column, row, s, t}, patch, h, counters);
        // Reuses the Hessian, which the first step changed equally little.
        const heightfield::DistanceDerivatives now(sheet_, patch, s, t, hs, ht, h.z);
        const double more_s = (jet.hst * now.gt - jet.htt * now.gs) * scale;
        const double more_t = (jet.hst * now.gs - jet.hss * now.gt) * scale;
        s += more_s;
        t += more_t;
        const double change = twist * size * (std::abs(more_s) + std::abs(more_t));
        if (kHessianChange * change <= enough && is_share(s) && is_share(t))
          return accept({column, row, s, t}, patch, h, counters);
      } else {
        last_column = column;
        last_row = row;
      }
      x = column + s;
      y = row + t;
    }
    return false;
  }

  [[gnu::always_inline]] bool accept(const heightfield::CellPosition& position,
                                     const heightfield::BilinearPatch& patch, const heightfield::PlanPoint& h,
                                     FrameCounters& counters) noexcept {
    const heightfield::PlanPoint god{position.column + position.s, position.row + position.t,
                                     patch.height(position.s, position.t)};
    if (!(h.z < god.z) || !(sheet_.distance_sq(god, h) <= sheet_.distance_sq(god_, h) * kNoFarther))
      return false;
    counters.walk_steps += position.column != position_.column || position.row != position_.row;
    const double lead_x = lead_x_, lead_y = lead_y_;
    set_god(position, patch, god, h);
    turn_x_ = lead_x_ - lead_x;
    turn_y_ = lead_y_ - lead_y;
    return true;
  }

  [[gnu::always_inline]] void set_god(const heightfield::CellPosition& position,
                                      const heightfield::BilinearPatch& patch,
                                      const heightfield::PlanPoint& god,
                                      const heightfield::PlanPoint& h) noexcept {
    position_ = position;
    god_ = god;
    patch_ = patch;
    lead_x_ = god.x - h.x;
    lead_y_ = god.y - h.y;
    turn_x_ = turn_y_ = 0.0;
  }

  /// The general path: descent over cells, leaving, the free HIP's segment. Returns whether it ends in
  /// contact.
  [[gnu::noinline]] bool update(const heightfield::PlanPoint& h, FrameStatus& status,
                                FrameCounters& counters) noexcept {
    if (!is_near(h) || !started_) {
      contact_ = false;
      started_ = true;
      start(h);
      return false;
    }
    int moves = heightfield::kMaxDescentMoves, tests_left = heightfield::kMaxCrossingTests;
    bool from_sheet = contact_;
    if (contact_ && stay(h, moves, status, counters)) return true;
    for (int entry = 0; entry < kMaxEntries; ++entry) {
      if (from_sheet && side_ == heightfield::SheetSide::kNowhere) return false;  // past the rim
      const heightfield::Crossing crossing = heightfield::find_crossing(
          sheet_, tested_to_, h, side_, from_sheet ? &position_ : nullptr, tests_left);
      counters.edges += static_cast<std::uint64_t>(crossing.edges);
      tested_to_ = crossing.reached;
      side_ = crossing.side;
      if (crossing.cut) status = FrameStatus::kBoundHit;
      if (!crossing.hit) {
        counters.cells_visited += static_cast<std::uint64_t>(heightfield::kMaxCrossingTests - tests_left);
        return false;
      }
      position_ = crossing.position;
      contact_ = true;
      if (stay(h, moves, status, counters)) return true;
      from_sheet = true;
    }
    status = FrameStatus::kBoundHit;
    return false;
  }

  /// In contact: moves the god object to its minimum. False if the HIP came out: above the sheet, with its
  /// way from the god object still to test, or past the rim, on no side.
  bool stay(const heightfield::PlanPoint& h, int& moves, FrameStatus& status,
            FrameCounters& counters) noexcept {
    const int before = moves;
    const heightfield::Descent end = heightfield::descend(sheet_, position_, h, moves);
    counters.walk_steps += static_cast<std::uint64_t>(before - moves);
    set_god(position_, sheet_.patch(position_.column, position_.row), sheet_.point(position_), h);
    if (!end.arrived) {
      status = FrameStatus::kBoundHit;
      return true;
    }
    if (!(h.z < god_.z)) {
      contact_ = false;
      tested_to_ = god_;
      side_ = heightfield::SheetSide::kAbove;
      return false;
    }
    if (end.at_rim && heightfield::side_of(sheet_, h) == heightfield::SheetSide::kNowhere) {
      contact_ = false;
      tested_to_ = h;
      side_ = heightfield::SheetSide::kNowhere;
      ++counters.edges;
      return false;
    }
    return true;
  }

  /// The frictionless contact at the god object, local.
  template <unsigned kFeatures>
  SurfaceContact contact_at(const Vec3& local) const noexcept {
    SurfaceContact contact;
    contact.hip = local;
    contact.pull = sheet_.local(god_) - local;
    std::size_t post = 0;
    if (nearest_post_ || kFeatures != 0) {
      const std::int32_t column = position_.column + (position_.s > kMiddle),
                         row = position_.row + (position_.t > kMiddle);
      post = static_cast<std::size_t>(row) * static_cast<std::size_t>(sheet_.columns) +
             static_cast<std::size_t>(column);
      if (nearest_post_)
        contact.pull =
            Vec3(column * sheet_.step_x, row * sheet_.step_y, static_cast<double>(sheet_.height[post])) -
            local;
    }
    if ((kFeatures & kVaried) != 0 && !model_.surface.by_point.empty()) {
      read_stiffness(contact);
      contact.static_friction = static_cast<double>(model_.surface.by_point[post].static_friction);
      contact.dynamic_friction = static_cast<double>(model_.surface.by_point[post].dynamic_friction);
    } else {
      contact.stiffness_n_per_mm = model_.surface.stiffness_n_per_mm;
      contact.static_friction = model_.surface.friction.static_coefficient;
      contact.dynamic_friction = model_.surface.friction.dynamic_coefficient;
    }
    return contact;
  }

  /// Bilinear between posts, with the gradient along the surface.
  void read_stiffness(SurfaceContact& contact) const noexcept {
    const PointSurface* const low =
        &model_.surface
             .by_point[static_cast<std::size_t>(position_.row) * static_cast<std::size_t>(sheet_.columns) +
                       static_cast<std::size_t>(position_.column)];
    const PointSurface* const up = low + sheet_.columns;
    const auto k = [](const PointSurface& place) { return static_cast<double>(place.stiffness_n_per_mm); };
    const double a = k(low[0]), b = k(low[1]) - a, c = k(up[0]) - a, d = k(up[1]) - k(up[0]) - b;
    contact.stiffness_n_per_mm = heightfield::BilinearPatch{a, b, c, d}.height(position_.s, position_.t);
    const Vec3 plan((b + d * position_.t) * sheet_.inverse_x, (c + d * position_.s) * sheet_.inverse_y, 0.0);
    const Vec3 normal(-(patch_.b + patch_.d * position_.t) * sheet_.inverse_x,
                      -(patch_.c + patch_.d * position_.s) * sheet_.inverse_y, 1.0);
    // Tangent along the surface that corresponds to the plan's gradient.
    contact.stiffness_gradient = plan - normal * (plan.dot(normal) / normal.squaredNorm());
  }

  heightfield::HeightFieldModel model_;
  heightfield::HeightFieldView sheet_;
  bool nearest_post_;

  SurfaceState state_;
  CorrectionRamp spread_;
  int frames_since_check_ = 0;  ///< contact frames since the last check of the HIP's surroundings
  bool started_ = false;
  bool contact_ = false;
  heightfield::CellPosition position_;                              ///< god object, in contact
  heightfield::PlanPoint god_;                                      ///< god object as a point
  heightfield::BilinearPatch patch_;                                ///< patch of its cell
  double lead_x_ = 0.0, lead_y_ = 0.0;                              ///< from the HIP to the god object, posts
  double turn_x_ = 0.0, turn_y_ = 0.0;                              ///< its change in the last frame
  heightfield::PlanPoint tested_to_;                                ///< free: end of the tested path
  heightfield::SheetSide side_ = heightfield::SheetSide::kNowhere;  ///< side of tested_to_
};

class HeightFieldRenderer final : public FrameLoopRenderer<HeightFieldSurface> {
 public:
  static constexpr Features kSupportedFeatures = kAllOfRigidSurfaces | Feature::kJointContact;
  // Measured estimates (see kReferenceMachine): 1,002,001 posts, table 12 of reproduce.
  static constexpr double kFrameUs = 0.10, kMsPerMillion = 45.0;

  explicit HeightFieldRenderer(const Options& options) : FrameLoopRenderer(options) {}

  Description describe() const override {
    return {
        "heightfield", "chapter 4 made right", "El-Far, chapter 4; bilinear surface and side ours",
        fmt::format("a model near the HIP: {} moves of the god object over cells, {} cells or blocks of the "
                    "HIP's segment, {} entries a frame; what is left is done in the next",
                    heightfield::kMaxDescentMoves, heightfield::kMaxCrossingTests, kMaxEntries),
        options_};
  }

 private:
  [[nodiscard]] heightfield::HeightFieldOptions build() const {
    const bool fills = options_.text("holes") == "fill";
    return {fills, !fills, kBlendResolutions};
  }
  [[nodiscard]] bool nearest_post() const { return options_.text("shading") == "nearest"; }

  Result<ModelDecisions> decide_model(const ModelInput& input,
                                      const PrepareContext& /*context*/) const override {
    PALPATE_ASSIGN(const heightfield::HeightFieldDecision decided,
                   heightfield::decide_heightfield(input, build()));
    return explanation(input, decided);
  }
  [[nodiscard]] ModelDecisions explanation(const ModelInput& input,
                                           const heightfield::HeightFieldDecision& decision) const {
    ModelDecisions out;
    out.prepare_ms = kMsPerMillion * 1e-6 * static_cast<double>(decision.lattice.posts());
    out.frame_us = kFrameUs;
    heightfield::describe_heightfield(input, build(), decision, kSupportedFeatures, out);
    out.decisions.push_back(
        nearest_post()
            ? Decision{"shading", "nearest", "as given: the god object is the post next to it", true}
            : Decision{"shading", "none", "the god object moves over the bilinear surface without steps"});
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) {
      PALPATE_ASSIGN(heightfield::HeightFieldModel built,
                     heightfield::build_height_field_model(input, build(), context, report));
      report.decisions.models.push_back(explanation(input, built.decided()));
      models_.add(std::make_unique<HeightFieldSurface>(std::move(built), nearest_post()));
    }
    return Done{};
  }
};

}  // namespace

RendererInfo heightfield_info() {
  RendererInfo info;
  info.name = "heightfield";
  info.summary = "the thesis's chapter 4, for height fields, made right";
  info.source = "El-Far, chapter 4; bilinear surface and side are ours";
  info.role = Role::kOurs;
  info.geometry = Geometry::kHeights;
  info.supports = HeightFieldRenderer::kSupportedFeatures;
  info.options = {
      option::choice("shading", "bilinear",
                     "god object: bilinear, the nearest point of the surface; nearest, the post next to it",
                     {"bilinear", "nearest"}),
      option::choice(
          "holes", "fill",
          fmt::format(
              "those narrower than {} posts: fill, the surface goes on as the points around say; open, "
              "as wider ones are",
              cloud::kGapPosts),
          {"fill", "open"})};
  info.make = [](const Options& options) { return std::make_unique<HeightFieldRenderer>(options); };
  return info;
}

}  // namespace palpate::render
