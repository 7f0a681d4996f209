#include "experiments/trade/dominance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

namespace palpate::experiments {
namespace {

/// A row's number with its uncertainty.
struct Compared {
  Measured measured{};
  bool is_time = false;
  double slack = 0.0;
  bool is_known = true;
  bool is_error = false;
};

/// The numbers compared between rows, in a fixed order.
class Numbers {
 public:
  void push_back(const Compared& one) { all_[size_++] = one; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] const Compared& operator[](std::size_t i) const { return all_[i]; }
  [[nodiscard]] Compared& back() { return all_[size_ - 1]; }

 private:
  std::array<Compared, 5> all_{};
  std::size_t size_ = 0;
};

Numbers numbers_of(const Row& row) {
  Numbers all;
  all.push_back({*row.load_percent, true});
  all.push_back({*row.frame_p999_us, true});
  all.push_back({Measured{static_cast<double>(*row.bytes)}});
  all.push_back({*row.prepare_ms, true, row.preparations > 1 ? 0.0 : kOncePrepared, !row.from_cache});
  all.push_back({*row.error_p95_percent, false, 0.0, true, true});
  // Errors below the rounding floor count as equal.
  if (const double floor = row.error_floor_percent.value_or(0.0); all.back().measured.value <= floor)
    all.back().measured = Measured{0.0, Interval{0.0, std::max(floor, row.error_p95_percent->high())}};
  return all;
}

Numbers numbers_of(const Row& row, Cost cost) {
  Numbers all = numbers_of(row);
  const std::size_t at = cost == Cost::kSpeed ? 0 : cost == Cost::kMemory ? 2 : 3;
  Numbers two;
  two.push_back(all[at]);
  two.push_back(all.back());
  return two;
}

/// Change of the machine between two rows.
class Drift {
 public:
  explicit Drift(const std::vector<Row>& rows) {
    for (const Row& row : rows)
      if (row.anchor_us) {
        auto [at, is_new] = extremes_.try_emplace(row.machine.hash, *row.anchor_us, *row.anchor_us);
        at->second.first = std::min(at->second.first, *row.anchor_us);
        at->second.second = std::max(at->second.second, *row.anchor_us);
      }
  }
  [[nodiscard]] double between(const Row& a, const Row& b) const {
    if (a.anchor_us && b.anchor_us) return ratio(*a.anchor_us, *b.anchor_us);
    const auto at = extremes_.find(a.machine.hash);
    return at == extremes_.end() ? 0.0 : ratio(at->second.first, at->second.second);
  }

 private:
  static double ratio(double a, double b) {
    const double low = std::min(a, b);
    return low > 0.0 ? std::max(a, b) / low - 1.0 : 0.0;
  }
  std::map<std::string, std::pair<double, double>> extremes_;
};

/// log of a / b; 0 for equal numbers, zeros included.
double log_ratio(double a, double b) {
  if (a == b) return 0.0;
  constexpr double kLeast = std::numeric_limits<double>::min();
  return std::log(std::max(a, kLeast)) - std::log(std::max(b, kLeast));
}

bool dominates(const Numbers& a, const Numbers& b, double drift) {
  bool better = false;
  double on_the_whole = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!a[i].is_known || !b[i].is_known) return false;  // unknown
    const double slack = std::max(a[i].slack, b[i].slack) + (a[i].is_time ? drift : 0.0);
    if (surely_less(b[i].measured, a[i].measured, slack)) return false;
    if (a[i].is_error && a[i].measured.value > (1.0 + kSameError) * b[i].measured.value) return false;
    better = better || surely_less(a[i].measured, b[i].measured, slack);
    on_the_whole += log_ratio(a[i].measured.value, b[i].measured.value);
  }
  return better && on_the_whole < 0.0;
}

/// For every row a row that dominates it, or itself.
std::vector<std::size_t> dominators(const std::vector<Row>& rows, const std::vector<Numbers>& numbers,
                                    const Drift& drift) {
  std::vector<std::size_t> by(rows.size());
  std::iota(by.begin(), by.end(), std::size_t{0});
  for (std::size_t b = 0; b < rows.size(); ++b)
    for (std::size_t a = 0; a < rows.size() && by[b] == b; ++a)
      if (a != b && !numbers[a].empty() && !numbers[b].empty() &&
          rows[a].machine.hash == rows[b].machine.hash &&
          dominates(numbers[a], numbers[b], drift.between(rows[a], rows[b])))
        by[b] = a;
  return by;
}

}  // namespace

const char* name_of(Cost cost) noexcept {
  return cost == Cost::kSpeed ? "speed" : cost == Cost::kMemory ? "memory" : "preparation";
}

std::optional<Measured> cost_of(const Row& row, Cost cost) {
  if (!row.ok()) return std::nullopt;
  if (cost == Cost::kSpeed) return row.load_percent;
  if (cost == Cost::kMemory) return Measured{row.bytes_per_point()};
  return row.from_cache ? std::nullopt : row.prepare_ms;
}

bool surely_less(const Measured& a, const Measured& b, double slack) noexcept {
  return a.high() * (1.0 + slack) < b.low();
}

std::vector<Standing> standings_of(const std::vector<Row>& rows) {
  const Drift drift(rows);
  std::vector<Standing> all(rows.size());
  std::vector<Numbers> numbers(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i].ok()) numbers[i] = numbers_of(rows[i]);
  const std::vector<std::size_t> by = dominators(rows, numbers, drift);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    all[i].dominated = by[i] != i;
    if (!all[i].dominated) continue;
    // The chain ends: each step is better on the whole.
    std::size_t best = by[i];
    while (by[best] != best) best = by[best];
    all[i].by = rows[best].setting;
  }
  for (const Cost cost : kCosts) {
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i].ok()) numbers[i] = numbers_of(rows[i], cost);
    const std::vector<std::size_t> beaten = dominators(rows, numbers, drift);
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i].ok() && beaten[i] == i && cost_of(rows[i], cost)) all[i].on_fronts.push_back(cost);
  }
  return all;
}

}  // namespace palpate::experiments
