#include "toolkit/render/heightfield_literal_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/render/heightfield_model.h"
#include "toolkit/render/roll_back.h"
#include "toolkit/render/shading.h"

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

class HeightFieldLiteral final : public HapticRenderer {
 public:
  explicit HeightFieldLiteral(const Options& options) : options_(options) {}

  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    PrepareReport report;
    Result<HeightFieldModel> built = build_height_field_model(scene, 0.0, context, report);
    if (!built) return std::move(built).error();
    model_ = std::move(*built);
    const cloud::HeightField& field = model_.field;
    columns_ = static_cast<std::int32_t>(field.columns);
    rows_ = static_cast<std::int32_t>(field.rows);
    end_x_ = columns_;
    end_y_ = rows_;
    inverse_x_ = 1.0 / field.step_x_mm;
    inverse_y_ = 1.0 / field.step_y_mm;
    force_limit_n_ =
        scene.force_limit_n > 0.0 ? scene.force_limit_n : std::numeric_limits<double>::infinity();
    walks_ = options_.text("response") == "walk";
    const std::string& shading = options_.text("shading");
    if (shading == "auto") {
      const bool shade = field.plan_resolution_mm() > kLiteralShadingResolutionMm;
      shading_ = shade ? Shading::kAreaRaw : Shading::kNone;
      report.notes.push_back(shade ? "shading: area-raw, the resolution is above 0.2 mm"
                                   : "shading: none, the resolution is at most 0.2 mm");
    } else {
      shading_ = parse_shading(shading);
    }
    if (!walks_) shading_ = Shading::kNone;
    if (model_.surface.texture.any())
      report.notes.push_back("texture: not rendered by the literal form, which prints no formula for it");
    return report;
  }

  void reset(const Vec3& /*hip_mm*/) noexcept override {
    collided_ = false;
    counters_ = {};
    now_s_ = 0.0;
    model_.pose.take(now_s_);
  }

  Frame step(const Vec3& hip_mm, double dt_s) noexcept override {
    model_.pose.take(now_s_ += dt_s);
    return walks_ ? walk_frame(hip_mm) : frame<false>(hip_mm);
  }

  FrameCounters counters() const noexcept override { return counters_; }

  Description describe() const override {
    return {
        "heightfield-literal", "chapter 4 as printed", "El-Far, chapter 4, figures 53 and 54",
        walks_ ? "unbounded, as printed: the walk from the entry cell grows with the way the HIP went since; "
                 "stopped after columns + rows moves"
               : "one look-up",
        options_};
  }

 private:
  template <bool kWalks>
  Frame frame(const Vec3& hip_mm) noexcept {
    ++counters_.frames;
    Frame frame;
    const Vec3 h = model_.pose.to_local(hip_mm);
    // 4.2.1: two divisions, a height, a comparison. The boxes stand around their posts.
    const double x = h.x() * inverse_x_ + 0.5, y = h.y() * inverse_y_ + 0.5;
    if (x >= 0.0 && y >= 0.0 && x < end_x_ && y < end_y_ && h.z() >= kLowest) {  // never what is no number
      const Post post{static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
      const auto top = static_cast<double>(model_.field.height_mm[place(post)]);
      if (h.z() < top) {  // never in a hole
        if constexpr (kWalks) {
          if (!collided_) {
            entry_ = post;
            held_ = kNobody;
          }
          collided_ = true;
          respond(h, frame);
        } else {
          answer(post, {h.x(), h.y(), top}, {0.0, 0.0, top - h.z()}, frame);
        }
        return frame;
      }
    }
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    collided_ = false;
    frame.god_object_mm = hip_mm;
    return frame;
  }
  // Apart, so that the look-up alone needs no registers for it.
  [[gnu::noinline]] Frame walk_frame(const Vec3& hip_mm) noexcept { return frame<true>(hip_mm); }

  std::size_t place(const Post& post) const noexcept {
    return static_cast<std::size_t>(post.row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(post.column);
  }
  /// Local; not a number in z over a hole.
  Vec3 at(const Post& post) const noexcept {
    return {post.column * model_.field.step_x_mm, post.row * model_.field.step_y_mm,
            static_cast<double>(model_.field.height_mm[place(post)])};
  }
  bool has(const Post& post) const noexcept {
    return static_cast<std::uint32_t>(post.column) < static_cast<std::uint32_t>(columns_) &&
           static_cast<std::uint32_t>(post.row) < static_cast<std::uint32_t>(rows_);
  }

  /// 4.3.2: from the entry post downhill in distance over the eight neighbours, to the post nearest to the
  /// HIP around there.
  void respond(const Vec3& h, Frame& frame) noexcept {
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
      ++counters_.walk_steps;
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
    answer(god, g, shading_ == Shading::kNone ? Vec3(g - h) : shaded(h, god), frame);
    if (moves == 0) {
      frame.status = FrameStatus::kBoundHit;
      ++counters_.bound_hits;
    }
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

  void answer(const Post& post, const Vec3& god, const Vec3& pull, Frame& frame) const noexcept {
    const double stiffness =
        (model_.surface.features & kVaried) != 0
            ? static_cast<double>(model_.surface.of_place[place(post)].stiffness_n_per_mm)
            : model_.surface.stiffness_n_per_mm;
    frame.contact = true;
    frame.model = 0;
    frame.god_object_mm = model_.pose.to_world(god);
    frame.force_n = limited_fast(model_.pose.direction_to_world(stiffness * pull), force_limit_n_);
  }

  Options options_;
  HeightFieldModel model_;
  std::int32_t columns_ = 0, rows_ = 0;
  double end_x_ = 0.0, end_y_ = 0.0;  ///< columns and rows
  double inverse_x_ = 1.0, inverse_y_ = 1.0;
  double force_limit_n_ = 0.0;
  Shading shading_ = Shading::kNone;
  bool walks_ = true;

  double now_s_ = 0.0;  ///< of a model that moves
  bool collided_ = false;
  Post entry_;           ///< where the first collision was detected
  Post held_ = kNobody;  ///< with friction, the god object of the frame before
  FrameCounters counters_;
};

}  // namespace

RendererInfo heightfield_literal_info() {
  RendererInfo info;
  info.name = "heightfield-literal";
  info.summary = "chapter 4 as printed: point in box, entry cell remembered";
  info.source = "El-Far, chapter 4";
  info.options = {
      {"response",
       OptionKind::kChoice,
       "walk",
       "god object: walk, the nearest post from the entry cell on (4.3.2); lookup, the box top over the HIP",
       {"walk", "lookup"}},
      shading_spec("force shading; auto: area-raw above a resolution of 0.2 mm, as printed")};
  info.make = [](const Options& options) { return std::make_unique<HeightFieldLiteral>(options); };
  return info;
}

}  // namespace palpate::render
