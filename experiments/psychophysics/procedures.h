// Procedures that choose the next difference from the answers so far, and the order of everything that is not
// chosen so. All deterministic: the same seed and the same answers give the same trials, so that a study is
// taken up again from its answers alone.
//
// Sources: Levitt, Transformed up-down methods in psychoacoustics, JASA 49 (1971); Kaernbach, Simple adaptive
// testing with the weighted up-down method, Perception & Psychophysics 49 (1991); Kontsevich and Tyler,
// Bayesian adaptive estimation of psychometric slope and threshold, Vision Research 39 (1999).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "experiments/psychophysics/psychometric.h"

namespace palpate::experiments::psychophysics {

/// Chooses differences. Not thread-safe.
class Adaptive {
 public:
  Adaptive() = default;
  Adaptive(const Adaptive&) = delete;
  Adaptive& operator=(const Adaptive&) = delete;
  virtual ~Adaptive() = default;
  /// The difference of the next trial; nothing when the procedure has ended.
  [[nodiscard]] virtual std::optional<double> level() const = 0;
  virtual void answered(bool correct) = 0;
  /// What the procedure itself says, where it has said enough: the level at target() right answers, or the
  /// JND.
  [[nodiscard]] virtual std::optional<Estimate> estimate() const = 0;
};

struct UpDownOptions {
  int down = 2;          ///< right answers in a row before the difference shrinks
  double target = 0.0;   ///< of the weighted rule: the share it converges to; 0: steps are equal
  double start = 1.0;    ///< the first difference
  double factor = 2.0;   ///< a step upwards multiplies by this
  int halved_after = 2;  ///< reversals after which steps have half their logarithm
  int reversals = 10;    ///< it ends after so many
  int discarded = 4;     ///< of which so many say nothing: the way in
  std::uint64_t most_trials = 200;
  double low = 0.0, high = 1e300;  ///< differences stay within
};
/// The share of right answers that the rule converges to: 2^(-1/down), or the target of the weighted one.
[[nodiscard]] double target_of(const UpDownOptions& options) noexcept;

/// Transformed up-down (Levitt) or weighted (Kaernbach: steps down are (1 - target)/target of steps up). Its
/// estimate is the geometric mean of the reversals that are kept; the interval their mean's, as if they were
/// independent, which they are not quite.
class UpDown final : public Adaptive {
 public:
  explicit UpDown(const UpDownOptions& options) : options_(options), level_(options.start) {}
  [[nodiscard]] std::optional<double> level() const override;
  void answered(bool correct) override;
  [[nodiscard]] std::optional<Estimate> estimate() const override;
  [[nodiscard]] const std::vector<double>& reversals() const noexcept { return reversals_; }

 private:
  void move(int direction);
  UpDownOptions options_;
  double level_;
  int right_ = 0, direction_ = 0;
  std::uint64_t trials_ = 0;
  std::vector<double> reversals_;
};

/// The JND of a run of a procedure, out of runs that are simulated from its `fit` and fitted as it was:
/// levels follow from answers there, so they are drawn anew as well. In logarithms: the fit less its mean
/// error in these runs (a staircase's fit is 6 % low), and what their percentiles leave on either side of it
/// (the basic bootstrap: plain percentiles count that error twice). `begin` makes the procedure. The same
/// seed, the same estimate.
[[nodiscard]] Estimate bootstrap_procedure(const std::function<std::unique_ptr<Adaptive>()>& begin,
                                           const PsychometricFit& fit, std::optional<double> slope,
                                           std::uint64_t seed, int resamples = kPsychometricResamples);

struct PsiOptions {
  Psychometric like;              ///< task, shape and lapse
  double low = 0.1, high = 10.0;  ///< differences and JNDs lie within
  double low_slope = 0.5, high_slope = 4.0;
  std::uint64_t trials = 60;
};

/// The Psi method: a posterior over JND and slope on a grid, and next the difference that is expected to
/// leave the least entropy. The prior is flat in the logarithms of both. Its estimate is the
/// posterior's mean of log JND, with the 95 % that the posterior holds. A step takes O(levels x JNDs x
/// slopes), 14,000 additions.
class Psi final : public Adaptive {
 public:
  explicit Psi(const PsiOptions& options);
  [[nodiscard]] std::optional<double> level() const override;
  void answered(bool correct) override;
  [[nodiscard]] std::optional<Estimate> estimate() const override;

 private:
  void choose();
  [[nodiscard]] double share(std::size_t level, std::size_t place) const {
    return shares_[level * posterior_.size() + place];
  }
  PsiOptions options_;
  std::vector<double> levels_, log_jnds_, slopes_;
  std::vector<double> shares_;     ///< by level, then JND, then slope
  std::vector<double> posterior_;  ///< by JND, then slope
  std::size_t next_ = 0;
  std::uint64_t trials_ = 0;
};

/// Element `index` of a list of `cells` cells that is walked again and again, each time in an order of its
/// own: counts of any two cells never differ by more than one. O(cells).
[[nodiscard]] std::size_t balanced_cell(std::uint64_t seed, std::uint64_t index, std::size_t cells);

/// Another seed, for another purpose.
[[nodiscard]] std::uint64_t seed_for(std::uint64_t seed, std::uint64_t purpose) noexcept;

}  // namespace palpate::experiments::psychophysics
