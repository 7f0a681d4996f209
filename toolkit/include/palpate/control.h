// Control stages around a renderer: virtual coupling, force filter, passivity. Only requested stages run.
//
// First:
//   palpate::control::ControlOptions control;
//   control.coupling = palpate::control::Coupling{1.0, 0.001};
//   auto renderer = palpate::control::wrap(std::move(inner), control);  // a renderer as any other
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/result.h>

namespace palpate::render {
class HapticRenderer;
}

namespace palpate::control {

/// Spring and damper between the device and the god object (docs/reference/scene-keys.md).
struct Coupling {
  double stiffness_n_per_mm = 0.0;  ///< k_c, above 0
  double damping_n_s_per_mm = 0.0;  ///< b_c, 0 or above
};

enum class FilterForm : std::uint8_t {
  /// Limits apply per time. A wanted force of zero takes effect at once. A force limited in direction is the
  /// projection of the wanted one, so it never pushes where nothing was wanted.
  kPerTime,
  /// The printed form: limits apply per frame, whatever its length (in units of kLiteralFrameS). A force
  /// limited in direction keeps its wanted size. After release the force fades by the same rule, outside the
  /// model.
  kLiteral,
};

/// A limit of 0 is no limit.
struct ForceFilterOptions {
  double rate_limit_n_per_s = 0.0;    ///< on the change of magnitude
  double turn_limit_deg_per_s = 0.0;  ///< on the change of direction while the force is not zero
  FilterForm form = FilterForm::kPerTime;
  [[nodiscard]] bool any() const noexcept { return rate_limit_n_per_s > 0.0 || turn_limit_deg_per_s > 0.0; }
};

/// The force that counts over the step from h(n-1) to h(n).
enum class EnergyRule : std::uint8_t {
  /// The mean of F(n-1) and F(n): the renderer's own energy. Exact for every force linear along the path's
  /// straight pieces, hence 0 for a spring on a closed path.
  kTrapezoid,
  /// F(n), as printed (f(n) v(n) T with the last step's velocity). Overcounts a spring by k dh^2 / 2 a step.
  kPrinted,
  /// F(n-1): a device that holds a force until the next. Exact for it on any path; undercounts a spring by k
  /// dh^2 / 2 a step, which is the energy leak of sampling.
  kHold,
};

/// Advised damping limit of the Phantom Omni, N s/mm; above it the device rattles.
inline constexpr double kDampingLimitNSPerMm = 0.005;

struct PassivityOptions {
  EnergyRule rule = EnergyRule::kTrapezoid;
  double damping_limit_n_s_per_mm = kDampingLimitNSPerMm;
};

/// The stages that a scene asks for; none by default.
struct ControlOptions {
  std::optional<Coupling> coupling;
  ForceFilterOptions filter;
  std::optional<PassivityOptions> passivity;
  [[nodiscard]] bool any() const noexcept { return coupling || filter.any() || passivity; }
};

/// The first invalid option as an Error, or nothing.
[[nodiscard]] Status check(const ControlOptions& options);

/// One line per active stage, with its numbers.
[[nodiscard]] std::vector<std::string> describe(const ControlOptions& options);

/// Wraps a renderer in control stages, composed once in this order:
///
///   renderer -> coupling -> filter -> passivity -> force limit
///
/// Without any option it returns `renderer` itself, so unused control costs nothing.
/// The scene's force limit applies once, at the end; the inner renderer is prepared without one, so that the
/// coupling sees the true stiffness. Contact, god object, model, status and counters are the renderer's. A
/// non-finite HIP leaves all stages unchanged.
/// `options` must satisfy check() (asserted). Adds at most about 1000 instructions a frame and no allocation.
[[nodiscard]] std::unique_ptr<render::HapticRenderer> wrap(std::unique_ptr<render::HapticRenderer> renderer,
                                                           const ControlOptions& options);

}  // namespace palpate::control
