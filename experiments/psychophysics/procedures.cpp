#include "experiments/psychophysics/procedures.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace palpate::experiments::psychophysics {
namespace {

// The Psi method's grid: a twentieth of the JNDs' range changes a share less than one trial resolves.
constexpr std::size_t kPsiJnds = 41, kPsiSlopes = 9, kPsiLevels = 21;
// Half a 95 % interval from a standard error of some six reversals: Student's t with so few degrees of
// freedom, 2.57.
constexpr double kStudentOfFew = 2.57;

/// `count` logarithmically spaced numbers from low to high.
std::vector<double> log_spaced(double low, double high, std::size_t count) {
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i)
    values.push_back(std::exp(std::log(low) + (std::log(high) - std::log(low)) * static_cast<double>(i) /
                                                  static_cast<double>(count - 1)));
  return values;
}

double entropy_term(double p) {
  return p > 0.0 ? -p * std::log(p) : 0.0;
}

}  // namespace

double target_of(const UpDownOptions& options) noexcept {
  return options.target > 0.0 ? options.target : std::exp2(-1.0 / options.down);
}

std::optional<double> UpDown::level() const {
  if (trials_ >= options_.most_trials || reversals_.size() >= static_cast<std::size_t>(options_.reversals))
    return std::nullopt;
  return level_;
}

void UpDown::move(int direction) {
  if (direction_ != 0 && direction != direction_) reversals_.push_back(level_);
  direction_ = direction;
  double step = std::log(options_.factor);
  if (reversals_.size() >= static_cast<std::size_t>(options_.halved_after)) step *= 0.5;
  if (direction < 0 && options_.target > 0.0) step *= (1.0 - options_.target) / options_.target;
  level_ = std::clamp(level_ * std::exp(direction * step), options_.low, options_.high);
}

void UpDown::answered(bool correct) {
  ++trials_;
  if (!correct) {
    right_ = 0;
    move(1);
  } else if (++right_ >= (options_.target > 0.0 ? 1 : options_.down)) {
    right_ = 0;
    move(-1);
  }
}

std::optional<Estimate> UpDown::estimate() const {
  const auto skipped = static_cast<std::size_t>(options_.discarded);
  if (reversals_.size() < skipped + 2) return std::nullopt;
  const auto kept = static_cast<double>(reversals_.size() - skipped);
  double sum = 0.0, squares = 0.0;
  for (std::size_t i = skipped; i < reversals_.size(); ++i) sum += std::log(reversals_[i]);
  const double mean = sum / kept;
  for (std::size_t i = skipped; i < reversals_.size(); ++i)
    squares += (std::log(reversals_[i]) - mean) * (std::log(reversals_[i]) - mean);
  const double error = kStudentOfFew * std::sqrt(squares / ((kept - 1.0) * kept));
  return Estimate{std::exp(mean), {std::exp(mean - error), std::exp(mean + error)}};
}

Estimate bootstrap_procedure(const std::function<std::unique_ptr<Adaptive>()>& begin,
                             const PsychometricFit& fit, std::optional<double> slope, std::uint64_t seed,
                             int resamples) {
  Random random(seed);
  std::vector<double> jnds;
  for (int r = 0; r < resamples; ++r) {
    const std::unique_ptr<Adaptive> procedure = begin();
    std::map<double, LevelAnswers> levels;
    while (const std::optional<double> level = procedure->level()) {
      LevelAnswers& one = levels.try_emplace(*level, LevelAnswers{*level, 0, 0}).first->second;
      const bool correct = random.uniform() < fit.function.proportion(*level);
      ++one.trials;
      one.correct += correct ? 1u : 0u;
      procedure->answered(correct);
    }
    std::vector<LevelAnswers> all;
    for (const auto& [level, answers] : levels) all.push_back(answers);
    if (const auto again = fit_psychometric(all, fit.function, slope)) jnds.push_back(again->function.jnd);
  }
  if (jnds.empty()) return {fit.function.jnd, {}};
  double log_mean = 0.0;
  for (const double jnd : jnds) log_mean += std::log(jnd) / static_cast<double>(jnds.size());
  const double found = std::log(fit.function.jnd);
  const Interval spread = percentiles(jnds);
  return {std::exp(2.0 * found - log_mean),
          {std::exp(2.0 * found - std::log(spread.high)), std::exp(2.0 * found - std::log(spread.low))}};
}

Psi::Psi(const PsiOptions& options) : options_(options) {
  levels_ = log_spaced(options.low, options.high, kPsiLevels);
  slopes_ = log_spaced(options.low_slope, options.high_slope, kPsiSlopes);
  const std::vector<double> jnds = log_spaced(options.low, options.high, kPsiJnds);
  for (const double jnd : jnds) log_jnds_.push_back(std::log(jnd));
  posterior_.assign(kPsiJnds * kPsiSlopes, 1.0 / static_cast<double>(kPsiJnds * kPsiSlopes));
  Psychometric function = options.like;
  for (const double level : levels_)
    for (const double jnd : jnds)
      for (const double slope : slopes_) {
        function.jnd = jnd;
        function.slope = slope;
        shares_.push_back(function.proportion(level));
      }
  choose();
}

void Psi::choose() {
  double least = 0.0;
  for (std::size_t l = 0; l < levels_.size(); ++l) {
    double right = 0.0;
    for (std::size_t i = 0; i < posterior_.size(); ++i) right += posterior_[i] * share(l, i);
    double entropy = 0.0;
    for (std::size_t i = 0; i < posterior_.size(); ++i) {
      const double hit = posterior_[i] * share(l, i), miss = posterior_[i] - hit;
      entropy += entropy_term(hit) + entropy_term(miss);
    }
    // The posterior's entropy after the answer: the joint entropy less the answer's.
    entropy -= entropy_term(right) + entropy_term(1.0 - right);
    if (l == 0 || entropy < least) least = entropy, next_ = l;
  }
}

std::optional<double> Psi::level() const {
  if (trials_ >= options_.trials) return std::nullopt;
  return levels_[next_];
}

void Psi::answered(bool correct) {
  double sum = 0.0;
  for (std::size_t i = 0; i < posterior_.size(); ++i) {
    const double p = share(next_, i);
    posterior_[i] *= correct ? p : 1.0 - p;
    sum += posterior_[i];
  }
  for (double& p : posterior_) p /= sum;
  ++trials_;
  if (trials_ < options_.trials) choose();
}

std::optional<Estimate> Psi::estimate() const {
  double mean = 0.0, below = 0.0;
  Interval interval{std::exp(log_jnds_.front()), std::exp(log_jnds_.back())};
  bool has_low = false;
  const double tail = kIntervalTailPercent / 100.0;
  for (std::size_t j = 0; j < kPsiJnds; ++j) {
    double mass = 0.0;
    for (std::size_t s = 0; s < kPsiSlopes; ++s) mass += posterior_[j * kPsiSlopes + s];
    mean += mass * log_jnds_[j];
    const double at = std::exp(log_jnds_[j]);
    if (!has_low && below + mass > tail) interval.low = at, has_low = true;
    if (below < 1.0 - tail) interval.high = at;
    below += mass;
  }
  return Estimate{std::exp(mean), interval};
}

std::size_t balanced_cell(std::uint64_t seed, std::uint64_t index, std::size_t cells) {
  std::vector<std::size_t> order(cells);
  std::iota(order.begin(), order.end(), std::size_t{0});
  Random random(seed_for(seed, index / cells));
  for (std::size_t i = cells; i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
  return order[index % cells];
}

std::uint64_t seed_for(std::uint64_t seed, std::uint64_t purpose) noexcept {
  // 2^64 over the golden ratio, odd, spreads purposes (Knuth); the generator mixes the rest.
  constexpr std::uint64_t kSpread = 0x9e3779b97f4a7c15u;
  Random random(seed ^ (kSpread * (purpose + 1)));
  return random.next();
}

}  // namespace palpate::experiments::psychophysics
