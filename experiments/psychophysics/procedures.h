// Adaptive procedures for differences, and balanced random orders. Deterministic in seed and answers, so a
// study can resume from its answers.
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
  /// The next trial's difference; empty when the procedure has ended.
  [[nodiscard]] virtual std::optional<double> level() const = 0;
  virtual void answered(bool correct) = 0;
  /// The procedure's own estimate, once it has enough answers: the level at target() right answers, or the
  /// JND.
  [[nodiscard]] virtual std::optional<Estimate> estimate() const = 0;
};

struct UpDownOptions {
  int down = 2;          ///< right answers in a row before the difference shrinks
  double target = 0.0;   ///< weighted rule: the share it converges to; 0: equal steps
  double start = 1.0;    ///< the first difference
  double factor = 2.0;   ///< of a step upwards
  int halved_after = 2;  ///< reversals after which steps have half their logarithm
  int reversals = 10;    ///< at which it ends
  int discarded = 4;     ///< first reversals left out, during the approach
  std::uint64_t most_trials = 200;
  double low = 0.0, high = 1e300;  ///< bounds of differences
};
/// Share of right answers that the rule converges to: 2^(-1/down), or the weighted rule's target.
[[nodiscard]] double target_of(const UpDownOptions& options) noexcept;

/// Transformed up-down (Levitt) or weighted (Kaernbach: steps down are (1 - target)/target of steps up).
/// Estimate: geometric mean of the kept reversals. The interval of that mean treats them as independent,
/// which they are only nearly.
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

/// JND of an adaptive run by the basic bootstrap, in logarithms. Runs simulated from `fit`, with levels that
/// follow from their answers, are fitted alike. The value is the fit less its mean error in these runs (a
/// staircase's fit is 6 % low); plain percentiles would count that error twice. `begin` makes the procedure.
/// Deterministic in the seed.
[[nodiscard]] Estimate bootstrap_procedure(const std::function<std::unique_ptr<Adaptive>()>& begin,
                                           const PsychometricFit& fit, std::optional<double> slope,
                                           std::uint64_t seed, int resamples = kPsychometricResamples);

struct PsiOptions {
  Psychometric like;              ///< task, shape and lapse
  double low = 0.1, high = 10.0;  ///< bounds of differences and JNDs
  double low_slope = 0.5, high_slope = 4.0;
  std::uint64_t trials = 60;
};

/// The Psi method: keeps a posterior over JND and slope on a grid and chooses the difference of least
/// expected entropy. The prior is flat in both logarithms. Estimate: the posterior mean of log JND and its
/// central 95 %. A step takes O(levels x JNDs x slopes), 14,000 additions.
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
  std::vector<double> shares_;     ///< by level, JND, slope
  std::vector<double> posterior_;  ///< by JND, slope
  std::size_t next_ = 0;
  std::uint64_t trials_ = 0;
};

/// Cell at `index` of repeated random permutations of `cells` cells: counts of two cells differ by at most
/// one. O(cells).
[[nodiscard]] std::size_t balanced_cell(std::uint64_t seed, std::uint64_t index, std::size_t cells);

/// Derives a seed for another purpose.
[[nodiscard]] std::uint64_t seed_for(std::uint64_t seed, std::uint64_t purpose) noexcept;

}  // namespace palpate::experiments::psychophysics
