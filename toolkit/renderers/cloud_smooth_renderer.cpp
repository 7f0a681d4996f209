#include "toolkit/render/correction_ramp.h"
#include "toolkit/renderers/renderer_infos.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include <palpate/result.h>
#include "toolkit/core/option_specs.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/surface_response.h"
#include "toolkit/spline_sdf/prepared_surface.h"
#include "toolkit/spline_sdf/spline_sdf_contact.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::render {
namespace {

/// The local model of `cloud-smooth`.
class SplineSdfModel {
 public:
  struct Memory {};
  static constexpr bool kTemplatedOnFeatures = true;

  /// `paged`: null for a surface that is whole in memory.
  SplineSdfModel(spline_sdf::SplineSdfBody body, int most_steps,
                 std::unique_ptr<spline_sdf::PagedContact> paged)
      : body_(std::move(body)), paged_(std::move(paged)) {
    if (paged_ != nullptr) return;
    contact_.attach(body_.smooth->grid, body_.smooth->spacing_mm);
    contact_.bound_steps(most_steps);
  }
  SplineSdfModel(const SplineSdfModel&) = delete;  // the contact points into the bricks
  SplineSdfModel& operator=(const SplineSdfModel&) = delete;

  [[nodiscard]] ModelPose& pose() noexcept { return body_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return body_.pose; }
  [[nodiscard]] unsigned features() const noexcept { return body_.surface.features; }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return body_.smooth->grid.box_mm; }
  [[nodiscard]] bool touching() const noexcept { return touched_->contact() || spread_.active(); }
  void restart(const Vec3& h) noexcept {
    if (paged_ != nullptr) {
      paged_->restart(h);
      touched_ = &paged_->active();
    } else {
      contact_.restart(h);
    }
    spread_.end();
    state_.release();
  }
  void release_contact(const Vec3& h) noexcept {
    if (paged_ != nullptr) {
      paged_->start_from(h);
      touched_ = &paged_->active();
    } else {
      contact_.start_from(h);
    }
    spread_.end();
    state_.release();
  }
  void release() noexcept { state_.release(); }

  template <unsigned kFeatures>
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept {
    if (paged_ != nullptr) [[unlikely]]
      return touch_paged<kFeatures>(h, contact, status, counters);
    const bool held = contact_.update(h, counters);
    if (contact_.bound_hit()) status = FrameStatus::kBoundHit;
    if (held) contact = contact_at<kFeatures>(h, contact_);
    return spread_.answer(h, held, contact, [&] { contact = contact_at<kFeatures>(h, contact_); });
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& contact) noexcept {
    return state_.respond<kFeatures>(contact, body_.surface.texture, body_.pose.origin_mm);
  }

 private:
  template <unsigned kFeatures>
  [[nodiscard, gnu::noinline]] bool touch_paged(const Vec3& h, SurfaceContact& contact, FrameStatus& status,
                                                FrameCounters& counters) noexcept {
    const bool held = paged_->update(h, counters);
    touched_ = &paged_->active();
    if (touched_->bound_hit()) status = FrameStatus::kBoundHit;
    if (held) contact = contact_at<kFeatures>(h, *touched_);
    return spread_.answer(h, held, contact, [&] { contact = contact_at<kFeatures>(h, *touched_); });
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceContact contact_at(const Vec3& h,
                                          const spline_sdf::SplineSdfContact& by) const noexcept {
    SurfaceContact contact = uniform_contact(body_.surface, h, by.god_object_mm() - h);
    if constexpr ((kFeatures & kVaried) != 0)
      if (!body_.corners.empty()) read_properties(contact);
    return contact;
  }

  /// Trilinear in the cell, with the stiffness's gradient along the surface.
  void read_properties(SurfaceContact& contact) const noexcept {
    const spline_sdf::BrickPosition at = contact_.place();
    const spline_sdf::CornerProperties& corners = body_.corners[contact_.brick()];
    const int base =
        (at.cell[0] * spline_sdf::kBrickCorners + at.cell[1]) * spline_sdf::kBrickCorners + at.cell[2];
    const Vec3 t(static_cast<double>(at.t[0]), static_cast<double>(at.t[1]), static_cast<double>(at.t[2]));
    double stiffness = 0.0, still = 0.0, moving = 0.0;
    Vec3 gradient = Vec3::Zero();
    for (int i = 0; i < 8; ++i) {
      const int x = i / 4, y = i / 2 % 2, z = i % 2;
      const double wx = x != 0 ? t.x() : 1.0 - t.x(), wy = y != 0 ? t.y() : 1.0 - t.y(),
                   wz = z != 0 ? t.z() : 1.0 - t.z();
      const int index = base + (x * spline_sdf::kBrickCorners + y) * spline_sdf::kBrickCorners + z;
      const PointSurface& corner = corners[static_cast<std::size_t>(index)];
      const auto k = static_cast<double>(corner.stiffness_n_per_mm);
      stiffness += wx * wy * wz * k;
      still += wx * wy * wz * static_cast<double>(corner.static_friction);
      moving += wx * wy * wz * static_cast<double>(corner.dynamic_friction);
      gradient += k * Vec3((x != 0 ? wy : -wy) * wz, (y != 0 ? wx : -wx) * wz, (z != 0 ? wx : -wx) * wy);
    }
    contact.stiffness_n_per_mm = stiffness;
    contact.static_friction = still;
    contact.dynamic_friction = moving;
    const Vec3& n = contact_.normal();
    contact.stiffness_gradient =
        (gradient - n * n.dot(gradient)) *
        (body_.smooth->grid.per_voxel * body_.smooth->grid.per_voxel_of(contact_.level()));
  }

  spline_sdf::SplineSdfBody body_;
  spline_sdf::SplineSdfContact contact_;
  std::unique_ptr<spline_sdf::PagedContact> paged_;
  const spline_sdf::SplineSdfContact* touched_ = &contact_;  ///< the one that answers
  CorrectionRamp spread_;
  SurfaceState state_;
};

class CloudSmooth final : public FrameLoopRenderer<SplineSdfModel> {
 public:
  static constexpr Features kSupportedFeatures = kAllOfRigidSurfaces | Feature::kJointContact;
  // Measured estimates (see kReferenceMachine): a torus of a million random points.
  static constexpr double kFrameUs = 0.25, kMsPerMillion = 2300.0;
  // A prepared file is opened, whatever its size.
  static constexpr double kOpenMs = 50.0;

  explicit CloudSmooth(const Options& options) : FrameLoopRenderer(options) {}

  Description describe() const override {
    return {"cloud-smooth", "a smooth surface near the points, through their noise",
            "ours; quadrics by Lepski's rule, cubic B-splines of distance",
            fmt::format(
                "a model near the HIP: {} steps of the god object, {} values and {} looks along the HIP's "
                "segment, {} entries a frame; what is left is done in the next",
                walk_steps(), spline_sdf::kMaxSegmentSamples, spline_sdf::kMaxBrickLookups,
                spline_sdf::kMaxEntriesPerFrame),
            options_};
  }

 private:
  [[nodiscard]] spline_sdf::SplineSdfOptions build() const {
    return {options_.number("detail"), options_.number("voxel"), options_.text("sides") == "both"};
  }

  [[nodiscard]] int walk_steps() const { return static_cast<int>(options_.integer("walk_steps")); }

  /// The surfaces of a prepared file, in place of building.
  Result<spline_sdf::SplineSdfBody> open_prepared(const ModelInput& input, const PrepareContext& context,
                                                  PrepareReport& report,
                                                  std::unique_ptr<spline_sdf::PagedContact>& paged) const {
    const spline_sdf::PagedOptions options{static_cast<std::size_t>(options_.integer("level")),
                                           static_cast<std::size_t>(options_.integer("resident_mb")) << 20,
                                           context.paced, walk_steps()};
    return spline_sdf::open_prepared_body(input, options, report, paged);
  }

  [[nodiscard]] Status check_build(const ModelInput& input) const {
    if (input.prepared == nullptr || build() == spline_sdf::SplineSdfOptions{}) return Done{};
    return Error{"detail, voxel and sides of a prepared file were chosen when it was prepared",
                 "leave them out, or prepare the scan again", input.prepared->path()};
  }

  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override {
    PALPATE_TRY(check_build(input));
    PALPATE_ASSIGN(const spline_sdf::SplineSdfDecision decided,
                   input.prepared != nullptr ? spline_sdf::decide_prepared(
                                                   input, static_cast<std::size_t>(options_.integer("level")))
                                             : spline_sdf::decide_spline_sdf(input, build(), context));
    return explanation(input, decided);
  }
  [[nodiscard]] ModelDecisions explanation(const ModelInput& input,
                                           const spline_sdf::SplineSdfDecision& decision) const {
    ModelDecisions out;
    out.prepare_ms =
        input.prepared != nullptr ? kOpenMs : kMsPerMillion * 1e-6 * static_cast<double>(input.cloud->size());
    out.frame_us = kFrameUs;
    spline_sdf::describe_spline_sdf(input, build(), decision, kSupportedFeatures, out);
    return out;
  }

  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override {
    for (const ModelInput& input : scene.models) {
      PALPATE_TRY(check_build(input));
      std::unique_ptr<spline_sdf::PagedContact> paged;
      PALPATE_ASSIGN(spline_sdf::SplineSdfBody built,
                     input.prepared != nullptr
                         ? open_prepared(input, context, report, paged)
                         : spline_sdf::build_spline_sdf_body(input, build(), context, report));
      report.decisions.models.push_back(explanation(input, built.decided()));
      report.notes.push_back(note_text(report.decisions.models.back().decisions.front()));
      report.read_rounding_mm =
          std::max(report.read_rounding_mm, spline_sdf::kReadRounding * built.smooth->grid.voxel_mm /
                                                built.smooth->grid.per_voxel_of(0));
      models_.add(std::make_unique<SplineSdfModel>(std::move(built), walk_steps(), std::move(paged)));
    }
    return Done{};
  }
};

}  // namespace

RendererInfo cloud_smooth_info() {
  RendererInfo info;
  info.name = "cloud-smooth";
  info.summary = "a smooth surface near the points, through their noise";
  info.source = "ours: robust quadrics of growing radius, baked into a B-spline of distance";
  info.role = Role::kOurs;
  info.supports = CloudSmooth::kSupportedFeatures;
  const spline_sdf::SplineSdfOptions standard;
  info.options = {
      option::number(
          "detail", fmt::format("{}", standard.detail),
          "standard errors of the measured noise before a deviation counts as shape; lower keeps more", 0.5,
          10.0),
      option::number("voxel", fmt::format("{}", standard.voxel_spacings),
                     "edge of the spline's cells, in spacings of the points; smaller is sharper at creases "
                     "and larger in "
                     "memory",
                     0.5, 8.0),
      option::choice("sides", "auto",
                     "of a piece that encloses a volume but for holes: the one where the replay begins is "
                     "felt (auto), or "
                     "both, as of a vase",
                     {"auto", "both"}),
      option::integer("walk_steps", fmt::format("{}", spline_sdf::kMaxNewtonSteps),
                      "steps of the god object in a frame, at most; what is left is done in the next", 4.0,
                      256.0),
      option::integer(
          "level", "0",
          "of a prepared file: which of its surfaces is felt; 0 is the finest, `palpate info` lists them",
          0.0, 15.0),
      option::integer("resident_mb", std::to_string(spline_sdf::kResidentBytes >> 20),
                      "of a prepared file: MB of its surface in memory at a time",
                      static_cast<double>(spline_sdf::kLeastResidentBytes >> 20), 1048576.0)};
  info.make = [](const Options& options) { return std::make_unique<CloudSmooth>(options); };
  return info;
}

}  // namespace palpate::render
