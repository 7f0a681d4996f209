#include "toolkit/render/brute_force_renderer.h"

#include <cmath>
#include <limits>

#include "toolkit/geometry/segment_box.h"
#include "toolkit/render/point_walk.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/sheet.h"

namespace palpate::render {
namespace {

/// The same surface as `cloud`, answered without grid or walk: the god object is the nearest of all points,
/// contact begins when a crossed box belongs to a plane the HIP went under, and the side is the one the HIP
/// came from. Where the nearest point is on the touched sheet (shallow probing of smooth parts) `cloud` must
/// agree with it exactly; in thin parts it pops through, as every nearest-point method does.
class BruteForce final : public HapticRenderer {
 public:
  explicit BruteForce(const Options& options) : options_(options) {}

  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    PrepareReport report;
    const Result<const ModelInput*> input = only_model(scene);
    if (!input) return input.error();
    Result<PointModel> built = build_point_model(**input, point_model_options(options_), context, report);
    if (!built) return std::move(built).error();
    model_ = std::move(*built);
    force_limit_n_ = scene.force_limit_n;
    shading_ = options_.text("shading") == "auto" ? Shading::kNone : parse_shading(options_.text("shading"));
    reset(model_.pose.to_world(Vec3::Zero()));
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    previous_ = model_.pose.to_local(hip_mm);
    near_ = contact_ = false;
    counters_ = {};
    closed_side_ =
        model_.closed && surface::is_enclosed(model_.points, model_.neighbours, previous_) ? -1.0 : 1.0;
  }

  Frame step(const Vec3& hip_mm, double) noexcept override {
    ++counters_.frames;
    Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    const Vec3 h = model_.pose.to_local(hip_mm);
    if (!near_ && crosses_a_box(previous_, h)) {
      near_ = true;
      const std::uint32_t start = nearest(previous_);
      outward_ = outward_at(start, (previous_ - model_.points[start].at()).normalized());
    }
    if (near_) {
      const std::uint32_t place = nearest(h);
      outward_ = outward_at(place, outward_);
      const Vec3 g = model_.points[place].at();
      const double height = outward_.dot(h - g);
      contact_ = height < 0.0;
      if (contact_) answer(h, place, frame);
      if (!contact_ && (h - g).norm() > model_.largest_half_box_mm.norm() * kLeaveHalfDiagonals)
        near_ = false;
    }
    previous_ = h;
    return frame;
  }

  FrameCounters counters() const noexcept override { return counters_; }
  Description describe() const override {
    return {"brute-force", "every point, every frame", "oracle", "unbounded: every frame reads all points",
            options_};
  }

 private:
  /// As `cloud` leaves a sheet.
  static constexpr double kLeaveHalfDiagonals = 1.5;

  /// The outward normal at a point: of a closed surface as stored, of any other the one nearer to `like`, and
  /// `like` itself where the points give no plane. The nearest point may jump from sheet to sheet, so no sign
  /// can be kept.
  Vec3 outward_at(std::uint32_t place, const Vec3& like) const noexcept {
    const surface::NormalCode code = model_.points[place].normal;
    if (code == surface::kNoNormal) return like;
    const Vec3 n = surface::decode_normal(code);
    const double side = surface::is_one_sided(code) ? closed_side_ : n.dot(like);
    return side < 0.0 ? Vec3(-n) : n;
  }

  std::uint32_t nearest(const Vec3& h) const noexcept {
    std::uint32_t best = 0;
    double d_best = std::numeric_limits<double>::infinity();
    for (std::uint32_t i = 0; i < model_.points.size(); ++i) {
      const double d = distance_sq(model_.points[i], h);
      if (d < d_best) {
        d_best = d;
        best = i;
      }
    }
    return best;
  }
  bool crosses_a_box(const Vec3& a, const Vec3& b) noexcept {
    const geometry::SegmentProbe probe(a, b);
    for (std::uint32_t i = 0; i < model_.points.size(); ++i)
      if (geometry::segment_touches_box(probe, model_.points[i].at(), model_.half_box(i))) return true;
    return false;
  }
  void answer(const Vec3& h, std::uint32_t place, Frame& frame) const noexcept {
    const Vec3 g = model_.points[place].at();
    Vec3 pull = g - h;
    if (shading_ != Shading::kNone) {
      WalkEnd end;
      end.place = place;
      end.look_around(model_, h);
      const NearestTwo two = nearest_two(model_, end);
      pull = shaded_vector(shading_, h, g, model_.points[two.first].at(), model_.points[two.second].at());
    }
    frame.contact = true;
    frame.model = 0;
    frame.god_object_mm = model_.pose.to_world(g);
    frame.force_n =
        limited(model_.pose.direction_to_world(model_.surface.stiffness_n_per_mm * pull), force_limit_n_);
  }

  Options options_;
  PointModel model_;
  Shading shading_ = Shading::kNone;
  double force_limit_n_ = 0.0;
  Vec3 previous_ = Vec3::Zero();
  Vec3 outward_ = Vec3::UnitZ();
  double closed_side_ = 1.0;  ///< as in `cloud`
  bool near_ = false;
  bool contact_ = false;
  FrameCounters counters_;
};

}  // namespace

RendererInfo brute_force_info() {
  RendererInfo info;
  info.name = "brute-force";
  info.summary = "every point, every frame: the oracle of tests";
  info.source = "oracle";
  info.options = point_model_specs();
  info.options.push_back(shading_spec("force shading; auto: none"));
  info.make = [](const Options& options) { return std::make_unique<BruteForce>(options); };
  return info;
}

}  // namespace palpate::render
