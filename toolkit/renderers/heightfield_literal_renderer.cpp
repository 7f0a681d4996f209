#include "toolkit/renderers/heightfield_literal_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "toolkit/heightfield/heightfield_model.h"
#include "toolkit/render/roll_back.h"
#include "toolkit/render/shading_decision.h"
#include "toolkit/render/shell_renderer.h"

namespace palpate::render {
namespace {

/// A column and a row.
struct Post {
  std::int32_t column = 0, row = 0;
  bool operator==(const Post&) const = default;
};

constexpr Post kNobody{-1, -1};
constexpr double kLowest = std::numeric_limits<double>::lowest();

/// The eight surface neighbours (4.3.2), row by row.
constexpr std::array<Post, 8> kAround = {
    {{-1, -1}, {0, -1}, {1, -1}, {-1, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}}};

/// The local model of `heightfield-literal`. The thesis does not say how several contacts combine.
class LiteralHeightField {
 public:
  struct Memory {};
  static constexpr bool kSums = true;

  LiteralHeightField(HeightFieldModel model, bool walks, Shading shading)
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
        look_up_alone_(!walks && !has_holes_) {}

  [[nodiscard]] ModelPose& pose() noexcept { return model_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return model_.pose; }
  void let_go(const Vec3& /*h*/) noexcept { collided_ = in_hole_ = false; }
  void release() noexcept {}
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept {
    const bool held =
        look_up_alone_ ? find<false, false>(h, status, counters) : find_composed(h, status, counters);
    contact.hip = h;
    contact.pull = answer_.god_object_mm - h;
    return held;
  }
  [[nodiscard]] SurfaceAnswer respond(const SurfaceContact& /*contact*/) const noexcept { return answer_; }

 private:
  template <bool kWalks, bool kHoles>
  bool find(const Vec3& h, FrameStatus& status, FrameCounters& counters) noexcept {
    // 4.2.1: two divisions, a height, a comparison. The boxes stand around their posts.
    const double x = h.x() * inverse_x_ + 0.5, y = h.y() * inverse_y_ + 0.5;
    if (x >= 0.0 && y >= 0.0 && x < end_x_ && y < end_y_ && h.z() >= kLowest) {  // never what is no number
      const Post post{static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
      const auto top = static_cast<double>(field_.height_mm[place(post)]);
      if (h.z() < top) {  // never in a hole
        if constexpr (kWalks) {
          if (!collided_) {
            entry_ = post;
            held_ = kNobody;
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
  // Apart, so that the look-up alone needs no registers for it.
  [[gnu::noinline]] bool find_composed(const Vec3& h, FrameStatus& status, FrameCounters& counters) noexcept {
    if (!has_holes_) return find<true, false>(h, status, counters);
    return walks_ ? find<true, true>(h, status, counters) : find<false, true>(h, status, counters);
  }

  /// What is printed knows nothing of posts without a point: over one nothing is felt. The HIP came under
  /// there when it is lower than one of the posts around.
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
  /// Local; not a number in z over a hole.
  Vec3 at(const Post& post) const noexcept {
    return {post.column * field_.step_x_mm, post.row * field_.step_y_mm,
            static_cast<double>(field_.height_mm[place(post)])};
  }
  bool has(const Post& post) const noexcept {
    return static_cast<std::uint32_t>(post.column) < static_cast<std::uint32_t>(columns_) &&
           static_cast<std::uint32_t>(post.row) < static_cast<std::uint32_t>(rows_);
  }

  /// 4.3.2: from the entry post downhill in distance over the eight neighbours, to the post nearest to the
  /// HIP around there.
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
          held_ == kNobody
              ? god
              : roll_back(
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

  /// Section 3.4 over the god object and its two neighbours nearest to the HIP: the pull.
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
            ? static_cast<double>(model_.surface.of_place[place(post)].stiffness_n_per_mm)
            : model_.surface.stiffness_n_per_mm;
    answer_ = {stiffness * pull, god};
  }

  HeightFieldModel model_;
  const cloud::HeightField& field_;
  std::int32_t columns_, rows_;
  double end_x_, end_y_;  ///< columns and rows
  double inverse_x_, inverse_y_;
  Shading shading_;
  bool walks_;
  bool has_holes_;
  bool look_up_alone_;

  bool collided_ = false;
  bool in_hole_ = false;  ///< under the surface over a post without a point
  Post entry_;            ///< where the first collision was detected
  Post held_ = kNobody;   ///< with friction, the god object of the frame before
  SurfaceAnswer answer_;  ///< of the last touch
};

class HeightFieldLiteral final : public ShellRenderer<LiteralHeightField> {
 public:
  static constexpr Features kFelt = kAllOfRigidSurfaces.without(Feature::kTexture);
  // Measured, what to expect (see kExpectedOn): table 12 of reproduce.
  static constexpr double kWalkUs = 2.7, kLookUpUs = 0.039, kMsPerMillion = 45.0;

  explicit HeightFieldLiteral(const Options& options) : ShellRenderer(options) {}

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
  [[nodiscard]] ShadingDecision shading_of(const HeightFieldDecision& decision) const {
    if (walks()) return decide_literal_shading(options_.text("shading"), decision.lattice.plan_resolution_mm);
    ShadingDecision none;
    none.said = {"shading", "none", "the box top over the HIP is looked up, no point is walked to"};
    return none;
  }

  Result<ModelDecisions> decide_model(const ModelInput& input,
                                      const PrepareContext& /*context*/) const override {
    const Result<HeightFieldDecision> decided = decide_heights(input, {});
    if (!decided) return decided.error();
    return said(input, *decided);
  }
  [[nodiscard]] ModelDecisions said(const ModelInput& input, const HeightFieldDecision& decision) const {
    ModelDecisions out;
    out.prepare_ms = kMsPerMillion * 1e-6 * static_cast<double>(decision.lattice.posts());
    out.frame_us = walks() ? kWalkUs : kLookUpUs;
    say_heights(input, {}, decision, kFelt, out);
    out.decisions.push_back(walks()
                                ? Decision{"response", "walk", "from the entry cell on, as printed (4.3.2)"}
                                : Decision{"response", "lookup", "as given", true});
    out.decisions.push_back(shading_of(decision).said);
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) {
      Result<HeightFieldModel> built = build_height_field_model(input, {}, context, report);
      if (!built) return std::move(built).error();
      const ShadingDecision shading = shading_of(built->decided());
      report.decisions.models.push_back(said(input, built->decided()));
      if (walks() && !shading.said.given) report.notes.push_back(note_of(shading.said));
      models_.add(std::make_unique<LiteralHeightField>(*std::move(built), walks(), shading.shading));
    }
    return Done{};
  }
  [[nodiscard]] Combine combine() const override { return Combine::kSum; }
  [[nodiscard]] bool walks() const { return options_.text("response") == "walk"; }
};

}  // namespace

RendererInfo heightfield_literal_info() {
  RendererInfo info;
  info.name = "heightfield-literal";
  info.summary = "chapter 4 as printed: point in box, entry cell remembered";
  info.source = "El-Far, chapter 4";
  info.role = Role::kLiteral;
  info.geometry = Geometry::kHeights;
  info.supports = HeightFieldLiteral::kFelt;
  info.options = {
      {"response",
       OptionKind::kChoice,
       "walk",
       "god object: walk, the nearest post from the entry cell on (4.3.2); lookup, the box top over the HIP",
       {"walk", "lookup"}},
      shading_spec("force shading; auto: area-raw above a resolution of 0.2 mm, as printed")};
  info.options.back().only_with = {{"response", {"walk"}}};
  info.make = [](const Options& options) { return std::make_unique<HeightFieldLiteral>(options); };
  return info;
}

}  // namespace palpate::render
