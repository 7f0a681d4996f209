#include <palpate/control.h>

#include <fmt/format.h>

#include <cassert>
#include <cmath>
#include <utility>

#include <palpate/renderer.h>
#include <palpate/result.h>
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::control {
namespace {

using render::Frame;

constexpr double kServoPeriodS = 1e-3;  // nominal servo period of stated conditions

/// "10 degrees arrive to 63 % in 6 ms and to 95 % in 9 ms", measured at 1 kHz.
std::string delay_of(const ForceFilterOptions& options, StepDelay FilterDelay::*which, const char* step) {
  const Result<FilterDelay> delay = filter_delay(options, {});
  if (!delay) return fmt::format("a step of {} does not arrive in {} frames", step, kMeasuredFrames);
  constexpr double kMsPerS = 1e3;
  const StepDelay& of = *delay.*which;
  std::string text = fmt::format("a step of {} arrives to 63 % in {:.3g} ms and to 95 % in {:.3g} ms", step,
                                 of.to_63_percent_s * kMsPerS, of.to_95_percent_s * kMsPerS);
  if (!of.ramp_lag_s) text += ", a steady change is never caught up with";
  return text;
}

template <bool kCouple, bool kFilter, bool kPassive>
class ControlledRenderer final : public render::HapticRenderer {
 public:
  ControlledRenderer(std::unique_ptr<render::HapticRenderer> inner, const ControlOptions& options)
      : inner_(std::move(inner)),
        options_(options),
        coupling_(options.coupling.value_or(Coupling{})),
        filter_(options.filter),
        passivity_(options.passivity.value_or(PassivityOptions{})) {}

  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& context) const override {
    Result<render::Decisions> decided = inner_->decide(unlimited(scene), context);
    if (decided) add_decisions(scene.force_limit_n, *decided);
    return decided;
  }
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override {
    force_limit_n_ = scene.force_limit_n;
    Result<render::PrepareReport> report = inner_->prepare(unlimited(scene), context);
    if (!report) return report;
    add_decisions(force_limit_n_, report->decisions);
    for (std::string& line : control::describe(options_))
      report->notes.push_back("control: " + std::move(line));
    report->bytes += sizeof(*this);
    return report;
  }

  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    inner_->restart(hip_mm, t_s);
    time_.restart(t_s);
    forget();
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    inner_->release_contact(hip_mm);
    time_.release_contact();
    forget();
  }

  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    const double dt_s = time_.advance(t_s);
    Frame frame = inner_->step(hip_mm, t_s);
    if (frame.status == render::FrameStatus::kNonFinite) return frame;
    if constexpr (kCouple)
      frame.force_n = coupling_.couple(hip_mm, frame.god_object_mm, frame.force_n, frame.contact, dt_s);
    if constexpr (kFilter) frame.force_n = filter_.filter(frame.force_n, dt_s);
    if constexpr (kPassive)
      frame.force_n = passivity_.control(hip_mm, frame.force_n, dt_s, force_limit_n_);
    else
      frame.force_n = render::limited(frame.force_n, force_limit_n_);
    return frame;
  }

  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept override { return inner_->depth_receiver(); }
  [[nodiscard]] render::FrameCounters counters() const noexcept override { return inner_->counters(); }

  [[nodiscard]] render::Description describe() const override {
    render::Description d = inner_->describe();
    for (const std::string& line : control::describe(options_)) d.summary += "; " + line;
    d.work_bound += "; control: some 1000 instructions";
    return d;
  }

 private:
  static render::SceneInput unlimited(render::SceneInput scene) {
    scene.force_limit_n = 0.0;
    return scene;
  }
  /// This renderer applies the limit, not the inner one.
  void add_decisions(double force_limit_n, render::Decisions& decided) const {
    const render::Decision limit = render::force_limit_decision(force_limit_n);
    for (render::Decision& d : decided.decisions)
      if (d.about == limit.about) d = limit;
    for (std::string& line : control::describe(options_))
      decided.decisions.push_back({"control", "on", std::move(line), true});
    decided.bytes += sizeof(*this);
  }
  /// Clears the stages' memory of earlier frames.
  void forget() noexcept {
    coupling_.reset();
    filter_.reset();
    passivity_.reset();
  }

  std::unique_ptr<render::HapticRenderer> inner_;
  render::FrameTime time_;
  ControlOptions options_;
  double force_limit_n_ = 0.0;
  VirtualCoupling coupling_;
  ForceFilter filter_;
  PassivityController passivity_;
};

template <bool... kStages>
std::unique_ptr<render::HapticRenderer> make(std::unique_ptr<render::HapticRenderer> inner,
                                             const ControlOptions& options) {
  return std::make_unique<ControlledRenderer<kStages...>>(std::move(inner), options);
}

/// Turns flags into template arguments one by one.
template <bool... kStages, class... Rest>
std::unique_ptr<render::HapticRenderer> choose(std::unique_ptr<render::HapticRenderer> inner,
                                               const ControlOptions& options, bool next, Rest... rest) {
  if constexpr (sizeof...(rest) == 0)
    return next ? make<kStages..., true>(std::move(inner), options)
                : make<kStages..., false>(std::move(inner), options);
  else
    return next ? choose<kStages..., true>(std::move(inner), options, rest...)
                : choose<kStages..., false>(std::move(inner), options, rest...);
}

}  // namespace

Status check(const ControlOptions& options) {
  if (options.coupling) PALPATE_TRY(check(*options.coupling));
  PALPATE_TRY(check(options.filter));
  if (options.passivity) {
    const double limit = options.passivity->damping_limit_n_s_per_mm;
    if (!std::isfinite(limit) || !(limit > 0.0))
      return Error{fmt::format("damping_limit_n_s_per_mm is {}", limit), "give a finite number above 0"};
  }
  return Done{};
}

std::vector<std::string> describe(const ControlOptions& options) {
  std::vector<std::string> lines;
  if (options.coupling) {
    const double needed =
        coupling_stability(*options.coupling, 0.0, kServoPeriodS).min_device_damping_n_s_per_mm;
    lines.push_back(
        fmt::format("virtual coupling of {} N/mm and {} N s/mm, passive at 1 kHz on a device with "
                    "more than {:.3g} N s/mm of damping",
                    options.coupling->stiffness_n_per_mm, options.coupling->damping_n_s_per_mm, needed));
  }
  const char* const form = options.filter.form == FilterForm::kLiteral ? ", from frame to frame" : "";
  // Each limit's own delay, without the other.
  if (options.filter.rate_limit_n_per_s > 0.0)
    lines.push_back(fmt::format(
        "force changes by at most {} N/s{}: {}", options.filter.rate_limit_n_per_s, form,
        delay_of({options.filter.rate_limit_n_per_s, 0.0, options.filter.form}, &FilterDelay::size, "1 N")));
  if (options.filter.turn_limit_deg_per_s > 0.0)
    lines.push_back(fmt::format("force turns by at most {} degrees/s{}: {}",
                                options.filter.turn_limit_deg_per_s, form,
                                delay_of({0.0, options.filter.turn_limit_deg_per_s, options.filter.form},
                                         &FilterDelay::direction, "10 degrees")));
  if (options.passivity)
    lines.push_back(fmt::format("passivity controller with at most {} N s/mm of damping",
                                options.passivity->damping_limit_n_s_per_mm));
  return lines;
}

std::unique_ptr<render::HapticRenderer> wrap(std::unique_ptr<render::HapticRenderer> renderer,
                                             const ControlOptions& options) {
  assert(check(options));
  if (!options.any()) return renderer;
  return choose<>(std::move(renderer), options, options.coupling.has_value(), options.filter.any(),
                  options.passivity.has_value());
}

}  // namespace palpate::control
