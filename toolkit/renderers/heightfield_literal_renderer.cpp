#include "toolkit/renderers/renderer_infos.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/core/option_specs.h"
#include "toolkit/heightfield/heightfield_model.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {
namespace {

/// Column and row.
struct Post {
  std::int32_t column = 0, row = 0;
  bool operator==(const Post&) const = default;
};

constexpr Post kNoPost{-1, -1};
constexpr double kLowest = std::numeric_limits<double>::lowest();

/// The eight surface neighbours (section 4.3.2), row by row.
constexpr std::array<Post, 8> kAround = {
    {{-1, -1}, {0, -1}, {1, -1}, {-1, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}}};

/// The local model of `heightfield-literal`. The thesis does not say how several contacts combine.
class LiteralHeightField {
 public:
  struct Memory {};
  static constexpr bool kForcesAddUp = true;

  LiteralHeightField(heightfield::HeightFieldModel model, bool walks, Shading shading)
      : model_(std::move(model)),
        field_(model_.field()),
        columns_(static_cast<std::int32_t>(field_.columns)),
        rows_(static_cast<std::int32_t>(field_.rows)),
        end_x_(columns_),
        end_y_(rows_),
        inverse_x_(1.0 / field_.step_x_mm),
        inverse_y_(1.0 / field_.step_y_mm),
        shading_(shading),
        walks_(walks),
        has_holes_(field_.holes > 0),
        lookup_only_(!walks && !has_holes_) {}

  [[nodiscard]] ModelPose& pose() noexcept { return model_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return model_.pose; }
  void release_contact(const Vec3& /*h*/) noexcept { collided_ = in_hole_ = false; }
  void release() noexcept {}
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept {
    const bool held =
        lookup_only_ ? find<false, false>(h, status, counters) : find_composed(h, status, counters);
    contact.hip = h;
    contact.pull = answer_.god_object_mm - h;
    return held;
  }
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& /*contact*/) const noexcept { return answer_; }

 private:
  template <bool kWalks, bool kHoles>
  bool find(const Vec3& h, FrameStatus& status, FrameCounters& counters) noexcept {
    // Section 4.2.1: two divisions, a height, a comparison. Boxes are centred at their posts.
    const double x = h.x() * inverse_x_ + 0.5, y = h.y() * inverse_y_ + 0.5;
    if (x >= 0.0 && y >= 0.0 && x < end_x_ && y < end_y_ && h.z() >= kLowest) {  // false for NaN
      const Post post{static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
      const auto top = static_cast<double>(field_.height_mm[place(post)]);
      if (h.z() < top) {  // false over a hole
        if constexpr (kWalks) {
          if (!collided_) {
            entry_ = post;
            held_ = kNoPost;
          }
          collided_ = true;
          respond_at(h, status, counters);
        } else {
          answer(post, {h.x(), h.y(), top}, {0.0, 0.0, top - h.z()});
        }
        if constexpr (kHoles) in_hole_ = false;
        return true;
      }
      if constexpr (kHoles) count_hole(post, h, counters);
    } else if constexpr (kHoles) {
      in_hole_ = false;
    }
    collided_ = false;
    return false;
  }
  // Not inlined, so that a plain look-up does not pay registers for it.
  [[gnu::noinline]] bool find_composed(const Vec3& h, FrameStatus& status, FrameCounters& counters) noexcept {
    if (!has_holes_) return find<true, false>(h, status, counters);
    return walks_ ? find<true, true>(h, status, counters) : find<false, true>(h, status, counters);
  }

  /// Counts an entry through a post without a point, over which the printed form feels nothing: the HIP was
  /// under it if lower than one of the surrounding posts.
  void count_hole(const Post& post, const Vec3& h, FrameCounters& counters) noexcept {
    bool under = false;
    if (std::isnan(field_.height_mm[place(post)]))
      around(post, [&](const Post& next) { under |= h.z() < at(next).z(); });
    counters.edges += under && !in_hole_;
    in_hole_ = under;
  }

  std::size_t place(const Post& post) const noexcept {
    return static_cast<std::size_t>(post.row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(post.column);
  }
  /// Local; z is NaN over a hole.
  Vec3 at(const Post& post) const noexcept {
    return {post.column * field_.step_x_mm, post.row * field_.step_y_mm,
            static_cast<double>(field_.height_mm[place(post)])};
  }
  bool has(const Post& post) const noexcept {
    return static_cast<std::uint32_t>(post.column) < static_cast<std::uint32_t>(columns_) &&
           static_cast<std::uint32_t>(post.row) < static_cast<std::uint32_t>(rows_);
  }

  /// Section 4.3.2: walks from the entry post over the eight neighbours, downhill in distance, to the post
  /// locally nearest to the HIP.
  void respond_at(const Vec3& h, FrameStatus& status, FrameCounters& counters) noexcept {
    Post god = entry_;
    double nearest_sq = (at(god) - h).squaredNorm();
    std::int32_t moves = columns_ + rows_;
    for (; moves > 0; --moves) {
      Post best = god;
      around(god, [&](const Post& next) {
        const double sq = (at(next) - h).squaredNorm();
        if (!(sq < nearest_sq)) return;
        nearest_sq = sq;
        best = next;
      });
      if (best == god) break;
      god = best;
      ++counters.walk_steps;
    }
    if ((model_.surface.features & kFriction) != 0)
      held_ = god =
          held_ == kNoPost
              ? god
              : roll_back_friction(
                    god, held_, h, model_.surface.static_friction(static_cast<std::uint32_t>(place(held_))),
                    columns_ + rows_, [this](const Post& p) { return at(p); },
                    [this](const Post& p, auto&& use) { around(p, use); });
    const Vec3 g = at(god);
    answer(god, g, shading_ == Shading::kNone ? Vec3(g - h) : shaded(h, god));
    if (moves == 0) status = FrameStatus::kBoundHit;
  }

  /// Calls use(post) for the posts around one.
  template <class Use>
  void around(const Post& post, Use&& use) const noexcept {
    for (const Post& way : kAround) {
      const Post other{post.column + way.column, post.row + way.row};
      if (has(other)) use(other);
    }
  }

  /// Section 3.4 over the god object and its two neighbours nearest to the HIP; returns the pull.
  Vec3 shaded(const Vec3& h, const Post& god) const noexcept {
    const Vec3 g = at(god);
    Vec3 first = g, second = g;
    double first_sq = std::numeric_limits<double>::infinity(), second_sq = first_sq;
    around(god, [&](const Post& next) {
      const Vec3 p = at(next);
      const double sq = (p - h).squaredNorm();
      if (sq < first_sq) {
        second = first;
        second_sq = first_sq;
        first = p;
        first_sq = sq;
      } else if (sq < second_sq) {
        second = p;
        second_sq = sq;
      }
    });
    return shaded_vector(shading_, h, g, first, second);
  }

  [[gnu::always_inline]] void answer(const Post& post, const Vec3& god, const Vec3& pull) noexcept {
    const double stiffness =
        (model_.surface.features & kVaried) != 0
            ? static_cast<double>(model_.surface.by_point[place(post)].stiffness_n_per_mm)
            : model_.surface.stiffness_n_per_mm;
    answer_ = {stiffness * pull, god};
  }

  heightfield::HeightFieldModel model_;
  const cloud::HeightField& field_;
  std::int32_t columns_, rows_;
  double end_x_, end_y_;  ///< columns and rows
  double inverse_x_, inverse_y_;
  Shading shading_;
  bool walks_;
  bool has_holes_;
  bool lookup_only_;

  bool collided_ = false;
  bool in_hole_ = false;    ///< under the surface at a post without a point
  Post entry_;              ///< post of the first collision
  Post held_ = kNoPost;     ///< last god object, with friction
  SurfaceResponse answer_;  ///< of the last touch
};

class HeightFieldLiteral final : public FrameLoopRenderer<LiteralHeightField> {
 public:
  static constexpr Features kSupportedFeatures = kAllOfRigidSurfaces.without(Feature::kTexture);
  // Measured estimates (see kReferenceMachine): table 12 of reproduce.
  static constexpr double kWalkUs = 2.7, kLookupUs = 0.039, kMsPerMillion = 45.0;

  explicit HeightFieldLiteral(const Options& options) : FrameLoopRenderer(options) {}

  Description describe() const override {
    return {
        "heightfield-literal", "chapter 4 as printed", "El-Far, chapter 4, figures 53 and 54",
        walks()
            ? "unbounded, as printed: the walk from the entry cell grows with the way the HIP went since; "
              "stopped after columns + rows moves"
            : "one look-up",
        options_};
  }

 private:
  [[nodiscard]] ShadingDecision shading_of(const heightfield::HeightFieldDecision& decision) const {
    if (walks()) return decide_literal_shading(options_.text("shading"), decision.lattice.plan_resolution_mm);
    ShadingDecision none;
    none.explanation = {"shading", "none", "the box top over the HIP is looked up, no point is walked to"};
    return none;
  }

  Result<ModelDecisions> decide_model(const ModelInput& input,
                                      const PrepareContext& /*context*/) const override {
    PALPATE_ASSIGN(const heightfield::HeightFieldDecision decided,
                   heightfield::decide_heightfield(input, {}));
    return explanation(input, decided);
  }
  [[nodiscard]] ModelDecisions explanation(const ModelInput& input,
                                           const heightfield::HeightFieldDecision& decision) const {
    ModelDecisions out;
    out.prepare_ms = kMsPerMillion * 1e-6 * static_cast<double>(decision.lattice.posts());
    out.frame_us = walks() ? kWalkUs : kLookupUs;
    heightfield::describe_heightfield(input, {}, decision, kSupportedFeatures, out);
    out.decisions.push_back(walks()
                                ? Decision{"response", "walk", "from the entry cell on, as printed (4.3.2)"}
                                : Decision{"response", "lookup", "as given", true});
    out.decisions.push_back(shading_of(decision).explanation);
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) {
      PALPATE_ASSIGN(heightfield::HeightFieldModel built,
                     heightfield::build_height_field_model(input, {}, context, report));
      const ShadingDecision shading = shading_of(built.decided());
      report.decisions.models.push_back(explanation(input, built.decided()));
      if (walks() && !shading.explanation.given) report.notes.push_back(note_text(shading.explanation));
      models_.add(std::make_unique<LiteralHeightField>(std::move(built), walks(), shading.shading));
    }
    return Done{};
  }
  [[nodiscard]] ContactCombination combine() const override { return ContactCombination::kSum; }
  [[nodiscard]] bool walks() const { return options_.text("response") == "walk"; }
};

}  // namespace

RendererInfo heightfield_literal_info() {
  RendererInfo info;
  info.name = "heightfield-literal";
  info.summary = "the thesis's chapter 4, for height fields, as printed";
  info.source = "El-Far, chapter 4";
  info.role = Role::kLiteral;
  info.geometry = Geometry::kHeights;
  info.supports = HeightFieldLiteral::kSupportedFeatures;
  info.options = {option::choice("response", "walk",
                                 "god object: walk, the nearest post from the entry cell on (4.3.2); lookup, "
                                 "the box top over the HIP",
                                 {"walk", "lookup"}),
                  shading_spec("force shading; auto: area-raw above a resolution of 0.2 mm, as printed")};
  info.options.back().only_with = {{"response", {"walk"}}};
  info.make = [](const Options& options) { return std::make_unique<HeightFieldLiteral>(options); };
  return info;
}

}  // namespace palpate::render
