#include "toolkit/renderers/brute_force_renderer.h"

#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "toolkit/geometry/segment_box.h"
#include "toolkit/points/free_sides.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/points/sheet.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/shell_renderer.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {
namespace {

/// The same surface as `cloud`, answered without grid or walk: the god object is the nearest of all points,
/// contact begins when a crossed box belongs to a plane the HIP went under, and the side is the one the HIP
/// came from. Where the nearest point is on the touched sheet (shallow probing of smooth parts) `cloud` must
/// agree with it exactly; in thin parts it pops through, as every nearest-point method does. Friction,
/// texture and deformation answer as in `cloud`, with the properties of that point.
class BruteModel {
 public:
  BruteModel(PointBody body, Shading shading)
      : body_(std::move(body)), model_(*body_.points), shading_(shading) {
    sides_.attach(model_);
  }

  struct Memory {};
  [[nodiscard]] ModelPose& pose() noexcept { return body_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return body_.pose; }
  void release() noexcept { state_.release(); }

  void let_go(const Vec3& h) noexcept {
    previous_ = h;
    near_ = contact_ = false;
    state_.release();
  }
  void restart(const Vec3& h) noexcept {
    let_go(h);
    sides_.find(model_, h);
  }

  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                           FrameStatus& /*status*/, FrameCounters& /*counters*/) noexcept {
    if (!near_ && crosses_a_box(previous_, h)) {
      near_ = true;
      const std::uint32_t start = nearest(previous_);
      outward_ = outward_at(start, (previous_ - model_.points[start].at()).normalized());
    }
    if (near_) {
      const std::uint32_t place = nearest(h);
      outward_ = outward_at(place, outward_);
      const Vec3 g = model_.points[place].at();
      contact_ = outward_.dot(h - g) < 0.0;
      if (contact_) contact = contact_at(h, place);
      if (!contact_ && (h - g).norm() > model_.largest_half_box_mm.norm() * kLeaveHalfDiagonals)
        near_ = false;
    }
    previous_ = h;
    return near_ && contact_;
  }
  [[nodiscard]] SurfaceAnswer respond(const SurfaceContact& contact) noexcept {
    SurfaceAnswer answer = respond_as_asked(state_, body_.surface, contact, body_.pose.origin_mm);
    // The point itself, moved by what friction and texture move it aside.
    if (contact.pull == pull_) answer.god_object_mm = god_ + (answer.god_object_mm - (contact.hip + pull_));
    return answer;
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
    const double side = surface::is_one_sided(code) ? sides_.at(model_, place) : n.dot(like);
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
  bool crosses_a_box(const Vec3& a, const Vec3& b) const noexcept {
    const geometry::SegmentProbe probe(a, b);
    for (std::uint32_t i = 0; i < model_.points.size(); ++i)
      if (geometry::segment_touches_box(probe, model_.points[i].at(), model_.half_box(i))) return true;
    return false;
  }
  SurfaceContact contact_at(const Vec3& h, std::uint32_t place) noexcept {
    const SurfaceField& surface = body_.surface;
    god_ = model_.points[place].at();
    pull_ = god_ - h;
    if (shading_ != Shading::kNone) {
      WalkEnd end;
      end.place = place;
      end.look_around(model_, h);
      const NearestTwo two = nearest_two(model_, end);
      pull_ = shaded_vector(shading_, h, god_, model_.points[two.first].at(), model_.points[two.second].at());
    }
    SurfaceContact contact = uniform_contact(surface, h, pull_);
    if (!surface.of_place.empty()) {
      const PlaceSurface& here = surface.of_place[place];
      contact.stiffness_n_per_mm = static_cast<double>(here.stiffness_n_per_mm);
      contact.static_friction = static_cast<double>(here.static_friction);
      contact.dynamic_friction = static_cast<double>(here.dynamic_friction);
    }
    return contact;
  }

  PointBody body_;
  const PointModel& model_;
  Shading shading_;
  SurfaceState state_;
  Vec3 god_ = Vec3::Zero(), pull_ = Vec3::Zero();  ///< of the last touch
  Vec3 previous_ = Vec3::Zero();
  Vec3 outward_ = Vec3::UnitZ();
  FreeSides sides_;  ///< as in `cloud`
  bool near_ = false;
  bool contact_ = false;
};

class BruteForce final : public ShellRenderer<BruteModel> {
 public:
  static constexpr Features kFelt = kAllOfRigidSurfaces | Feature::kJointContact;

  explicit BruteForce(const Options& options) : ShellRenderer(options) {}

  Description describe() const override {
    return {"brute-force", "every point, every frame", "oracle", "unbounded: every frame reads all points",
            options_};
  }

 private:
  [[nodiscard]] Decision shading_decision() const {
    const std::string& shading = options_.text("shading");
    if (shading == "auto") return {"shading", "none", "the nearest point answers as it is"};
    return {"shading", shading, "as given", true};
  }
  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override {
    const Result<PointModelDecision> decided =
        decide_point_model(input, point_model_options(options_), context);
    if (!decided) return decided.error();
    return said(input, *decided);
  }
  [[nodiscard]] ModelDecisions said(const ModelInput& input, const PointModelDecision& decided) const {
    ModelDecisions out;
    out.name = input.name;
    say_points(*input.cloud, point_model_options(options_), decided.points, out);
    out.decisions.push_back({"search", "none", "every point is read in every frame"});
    out.decisions.push_back(shading_decision());
    say_surface(input, decided.surface, kFelt, input.cloud->size(), out);
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    const PointModelOptions o = point_model_options(options_);
    for (const ModelInput& input : scene.models) {
      Result<PointBody> built = build_point_body(input, o, context, report);
      if (!built) return std::move(built).error();
      report.decisions.models.push_back(said(input, built->decided()));
      models_.add(std::make_unique<BruteModel>(std::move(*built), parse_shading(shading_decision().choice)));
    }
    return Done{};
  }
};

}  // namespace

RendererInfo brute_force_info() {
  RendererInfo info;
  info.name = "brute-force";
  info.summary = "every point, every frame: the oracle of tests";
  info.source = "oracle";
  info.role = Role::kOracle;
  info.supports = BruteForce::kFelt;
  for (OptionSpec& spec : point_model_specs())
    if (spec.key != "cell") info.options.push_back(std::move(spec));  // it looks into no grid
  info.options.push_back(shading_spec("force shading; auto: none"));
  info.make = [](const Options& options) { return std::make_unique<BruteForce>(options); };
  return info;
}

}  // namespace palpate::render
