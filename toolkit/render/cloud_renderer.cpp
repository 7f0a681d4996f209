#include "toolkit/render/cloud_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "toolkit/core/tolerances.h"
#include "toolkit/render/cloud_slot.h"
#include "toolkit/render/editable.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/near_models.h"
#include "toolkit/render/slow_phase.h"

namespace palpate::render {
namespace {

/// The scene has several models, or some that move: a feature of the frame beside those of SurfaceFeature.
constexpr unsigned kScene = kSurfaceFeatures;
/// Points that a surface that gives way may gain by stretching, as a share of those it has, and at least.
constexpr double kSpareShare = 0.125;
constexpr std::size_t kLeastSpare = 256;
/// Changes remembered for undo: some four thousand frames of a full dent, 32 MB.
constexpr std::size_t kJournalPoints = std::size_t{1} << 19;

class Cloud final : public HapticRenderer, public Editable, public SlowPhase {
 public:
  explicit Cloud(const Options& options) : options_(options) {}

  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    PrepareReport report;
    if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]", {}, 0};
    slots_.clear();
    features_ = scene.models.size() > 1 ? kScene : 0;
    for (const ModelInput& input : scene.models)
      if (const Status done = prepare_slot(input, context, report); !done) return done.error();
    frame_ = composed(std::make_integer_sequence<unsigned, 2 * kScene>{})[features_];
    if ((features_ & kScene) != 0) index_boxes(report);
    force_limit_n_ = scene.force_limit_n;
    sum_ = options_.text("combine") == "sum";
    reset(Vec3::Zero());
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    counters_ = {};
    now_s_ = 0.0;
    for (const auto& slot : slots_) {
      slot->model.pose.take(now_s_);
      if (slot->deformer != nullptr) slot->deformer->reset();
      slot->contact.reset(slot->model.pose.to_local(hip_mm));
      slot->state.release();
      slot->pressed = false;
    }
    near_.reset(hip_mm,
                [this](std::uint32_t i, const Vec3& hip, double t_s) noexcept { enter(i, hip, t_s); });
  }

  /// The frame is composed of what the scene asks for: of sixteen, one is ever run.
  Frame step(const Vec3& hip_mm, double dt_s) noexcept override {
    now_s_ += dt_s;
    dt_s_ = dt_s;
    return (this->*frame_)(hip_mm);
  }

  FrameCounters counters() const noexcept override { return counters_; }

  void run_slow_phase_elsewhere() noexcept override { near_.run_elsewhere(); }
  void slow_phase(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept override {
    near_.slow_phase(t_s, from_mm, to_mm);
  }

  bool undo(std::size_t model) noexcept override {
    Deformer* deformer = model < slots_.size() ? slots_[model]->deformer.get() : nullptr;
    return deformer != nullptr && deformer->undo();
  }
  void restore(std::size_t model) noexcept override {
    if (model < slots_.size() && slots_[model]->deformer != nullptr) slots_[model]->deformer->reset();
  }
  Result<cloud::Cloud> edited(std::size_t model) const override {
    if (model >= slots_.size() || slots_[model]->deformer == nullptr)
      return Error{"this model does not give way", "give it a [model.surface.dent]", {}, 0};
    return slots_[model]->deformer->edited();
  }
  DeformCounters deform_counters(std::size_t model) const noexcept override {
    return model < slots_.size() && slots_[model]->deformer != nullptr ? slots_[model]->deformer->counters()
                                                                       : DeformCounters{};
  }

  Description describe() const override {
    return {"cloud", "chapter 3 made right",
            "El-Far, chapter 3; side, bounds, creases, friction cone and joint contact ours",
            fmt::format("a model near the HIP: {} moves of the god object and {} along an edge, {} wider "
                        "looks of 64 points, {} "
                        "box tests, segments of {} cells, at a crease {} facets and as many lines a frame; "
                        "what is left is done "
                        "in the next; up to {} touched at once",
                        kMaxWalkSteps, kMaxFaceMoves, kMaxRescues, kMaxBoxTests, kMaxSegmentCells,
                        neighbourhood::kNeighbours, kMaxTouched),
            options_};
  }

 private:
  Status prepare_slot(const ModelInput& input, const PrepareContext& context, PrepareReport& report) {
    auto slot = std::make_unique<CloudSlot>();
    PointModelOptions o = point_model_options(options_);
    o.blend_resolutions = kBlendResolutions;
    const bool gives = input.surface.dent.any() || input.moves != nullptr;
    if (gives) {
      o.partition = PartitionKind::kMoving;
      o.spare_points =
          static_cast<std::size_t>(kSpareShare * static_cast<double>(input.cloud->size())) + kLeastSpare;
    }
    Result<PointModel> built = build_point_model(input, o, context, report);
    if (!built) return std::move(built).error();
    slot->model = std::move(*built);
    choose_shading(*slot, report);
    slot->contact.attach(slot->model);
    features_ |= slot->model.surface.features;
    if (input.motion != nullptr || gives) features_ |= kScene;
    if (gives) {
      Deformer::Options deform;
      deform.spare_points = o.spare_points;
      deform.journal_points = std::min(slot->model.points.size() + o.spare_points, kJournalPoints);
      slot->deformer = std::make_unique<Deformer>(slot->model, deform);
      slot->dent = input.surface.dent;
      slot->moves = input.moves;
      report.bytes += slot->deformer->bytes();
      report.notes.push_back(
          fmt::format("deformation: up to {} points a frame, {} spare ones, {} changes undone",
                      kMaxMovedPoints, deform.spare_points, deform.journal_points));
    }
    slots_.push_back(std::move(slot));
    return Done{};
  }

  using FrameFunction = Frame (Cloud::*)(const Vec3&) noexcept;
  template <unsigned... kFeatures>
  static constexpr std::array<FrameFunction, sizeof...(kFeatures)> composed(
      std::integer_sequence<unsigned, kFeatures...>) noexcept {
    return {&Cloud::frame<kFeatures>...};
  }

  void index_boxes(PrepareReport& report) {
    std::vector<ModelBox> boxes;
    for (const auto& slot : slots_) {
      const PointModel& model = slot->model;
      geometry::Aabb box;
      for (const StoredPoint& p : model.points) box.add(p.at());
      box = {box.low_mm + model.pose.origin_mm - model.largest_half_box_mm,
             box.high_mm + model.pose.origin_mm + model.largest_half_box_mm};
      boxes.push_back({box, model.pose.world_from_model, model.pose.motion});
    }
    near_.build(std::move(boxes));
    report.bytes += near_.bytes();
  }

  void choose_shading(CloudSlot& slot, PrepareReport& report) const {
    const std::string& shading = options_.text("shading");
    if (shading != "auto") {
      slot.shading = parse_shading(shading);
      return;
    }
    // Each change of point moves the force by stiffness x spacing; where no spacing is large enough, nothing
    // is shaded and the frame is built without it.
    const double stiffness = slot.model.surface.largest_stiffness_n_per_mm;
    const double largest = stiffness * slot.model.max_spacing_mm;
    slot.by_spacing = largest > kFeltForceStepN;
    slot.shading = slot.by_spacing ? Shading::kFacet : Shading::kNone;
    const double felt_mm = kFeltForceStepN / stiffness;
    slot.felt_spacing_sq_mm2 = felt_mm * felt_mm;
    report.notes.push_back(fmt::format("shading: {}, stiffness x spacing is at most {:.3g} N ({} N is felt)",
                                       slot.by_spacing ? "facet where spacing asks for it" : "none", largest,
                                       kFeltForceStepN));
  }

  template <unsigned kFeatures>
  Frame frame(const Vec3& hip_mm) noexcept {
    ++counters_.frames;
    Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    if constexpr ((kFeatures & kScene) != 0)
      many<kFeatures & ~kScene>(hip_mm, frame);
    else
      single<kFeatures>(hip_mm, frame);
    counters_.bound_hits += frame.status == FrameStatus::kBoundHit;
    return frame;
  }

  template <unsigned kFeatures>
  void single(const Vec3& hip_mm, Frame& frame) noexcept {
    CloudSlot& slot = *slots_.front();
    const Vec3 h = slot.model.pose.to_local(hip_mm);
    WalkEnd end;
    const bool touching = slot.contact.update(h, end, counters_);
    if (slot.contact.bound_hit()) frame.status = FrameStatus::kBoundHit;
    if (touching)
      answer<kFeatures>(slot, contact_at<kFeatures>(slot, end, h), 0, frame);
    else if constexpr (kFeatures != 0)
      slot.state.release();
  }

  /// The frame of one contact, force and god object added to what is there.
  template <unsigned kFeatures>
  void answer(CloudSlot& slot, const SurfaceContact& contact, std::int32_t model, Frame& frame) noexcept {
    const SurfaceAnswer answer =
        slot.state.respond<kFeatures>(contact, slot.model.surface.texture, slot.model.pose.origin_mm);
    frame.contact = true;
    frame.model = model;
    frame.god_object_mm = slot.model.pose.to_world(answer.god_object_mm);
    frame.force_n = limited(slot.model.pose.direction_to_world(answer.force_n), force_limit_n_);
  }

  /// The models near the HIP, each with its pose of this instant: the HIP's way is taken in each one's own
  /// frame, so that a model that moves on to a resting HIP meets it.
  template <unsigned kFeatures>
  void many(const Vec3& hip_mm, Frame& frame) noexcept {
    const auto entering = [this](std::uint32_t i, const Vec3& hip, double t_s) noexcept {
      enter(i, hip, t_s);
    };
    const auto touching = [this](std::uint32_t i) noexcept { return slots_[i]->contact.contact(); };
    if (!near_.choose(hip_mm, now_s_, entering, touching)) frame.status = FrameStatus::kBoundHit;
    std::size_t touched = 0;
    for (const std::uint32_t index : near_.models()) {
      CloudSlot& slot = *slots_[index];
      CloudTouch& touch = touches_[std::min(touched, kMaxTouched - 1)];
      slot.model.pose.take(now_s_);
      take_moves(slot, counters_);
      const Vec3 h = slot.model.pose.to_local(hip_mm);
      const bool held = slot.contact.update(h, touch.end, counters_);
      if (slot.contact.bound_hit()) frame.status = FrameStatus::kBoundHit;
      if (!held) {
        slot.state.release();
        slot.pressed = false;
        continue;
      }
      if (touched == kMaxTouched) {
        frame.status = FrameStatus::kBoundHit;
        continue;
      }
      touch.slot = &slot;
      touch.model = static_cast<std::int32_t>(index);
      touch.contact = contact_at<kFeatures>(slot, touch.end, h);
      ++touched;
    }
    near_.done(hip_mm, now_s_);
    if (touched == 1) {
      CloudTouch& touch = touches_.front();
      answer<kFeatures>(*touch.slot, touch.contact, touch.model, frame);
    } else if (touched > 1) {
      const auto touches = std::span(touches_).first(touched);
      const auto plane_at = [this](const CloudTouch& touch, const Vec3& at, JointPlanes& planes) noexcept {
        const CloudSlot& slot = *touch.slot;
        planes.add(plane_near(slot, touch.end.place, slot.model.pose.to_local(at), counters_));
      };
      if (!sum_) constrain_jointly(hip_mm, touches, plane_at);
      const auto respond = [](CloudTouch& touch) noexcept {
        const PointModel& model = touch.slot->model;
        return touch.slot->state.respond<kFeatures>(touch.contact, model.surface.texture,
                                                    model.pose.origin_mm);
      };
      add_up(touches, respond, force_limit_n_, frame);
    }
    for (std::size_t i = 0; i < touched; ++i) give_way(*touches_[i].slot, touches_[i].contact, dt_s_);
  }

  /// A model that comes near was clear of the HIP up to then; its contact starts there.
  void enter(std::uint32_t index, const Vec3& hip_mm, double t_s) noexcept {
    CloudSlot& slot = *slots_[index];
    slot.model.pose.take(t_s);
    slot.contact.start_from(slot.model.pose.to_local(hip_mm));
    slot.state.release();
  }

  Options options_;
  std::vector<std::unique_ptr<CloudSlot>> slots_;
  std::array<CloudTouch, kMaxTouched> touches_;
  NearModels near_;  ///< built in a scene of several models, or moving ones
  FrameFunction frame_ = nullptr;
  unsigned features_ = 0;
  bool sum_ = false;  ///< several models: the sum of their forces
  double force_limit_n_ = 0.0;
  double dt_s_ = 0.0;
  double now_s_ = 0.0;  ///< time of this frame
  FrameCounters counters_;
};

}  // namespace

RendererInfo cloud_info() {
  RendererInfo info;
  info.name = "cloud";
  info.summary = "chapter 3 made right: a contact state with a side, shading by stiffness and spacing";
  info.source = "El-Far, chapter 3; contact side, creases, friction cone, joint contact and bounds are ours";
  info.options = point_model_specs();
  for (OptionSpec& spec : info.options)
    if (spec.key == "cell") spec.default_value = "0";
  for (OptionSpec& spec : box_test_specs()) info.options.push_back(std::move(spec));
  info.options.push_back(partition_spec());
  info.options.push_back(shading_spec("force shading; auto: facet where stiffness x local spacing is felt"));
  info.options.push_back({"combine",
                          OptionKind::kChoice,
                          "joint",
                          "several models touched at once: constrained jointly, or the sum of their forces",
                          {"joint", "sum"}});
  info.make = [](const Options& options) { return std::make_unique<Cloud>(options); };
  return info;
}

}  // namespace palpate::render
