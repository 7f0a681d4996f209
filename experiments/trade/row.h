// The measurements of one setting on one machine: a JSON line of rows.jsonl. Rows are a sweep's raw data:
// kept, merged, drawn and never changed.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/statistics.h"

namespace palpate::experiments {

inline constexpr const char* kRowsFile = "rows.jsonl";
/// Holds a hundred thousand rows of some 1,500 bytes.
inline constexpr std::uint64_t kMostRowsBytes = std::uint64_t{1} << 28;

/// The row's machine. Times are comparable on the same machine only.
struct RowMachine {
  std::string name;  ///< host name
  std::string cpu;   ///< the processor's name
  std::string hash;  ///< of name, CPU, cores and kernel: identifies the machine
  int cores = 0;
};
[[nodiscard]] RowMachine this_machine();

/// A number with its interval; exact without one.
struct Measured {
  double value = 0.0;
  std::optional<Interval> interval{};
  [[nodiscard]] double low() const noexcept { return interval ? interval->low : value; }
  [[nodiscard]] double high() const noexcept { return interval ? interval->high : value; }
};

struct Row {
  std::string setting;     ///< Setting::text
  std::string experiment;  ///< of scene, path, truth and program: rows of different experiments never mix
  RowMachine machine;
  std::string renderer;                                      ///< in the registry
  std::string works_on;                                      ///< points, mesh, heights
  std::vector<std::pair<std::string, std::string>> options;  ///< as given, and "clean"
  std::vector<std::string> axes;                             ///< axes with unusual values
  int precision_bits = 0;
  int rate_divisor = 1;
  double rate_hz = 0.0;
  std::string status = "ok";  ///< or "did-not-finish", "failed"
  std::string reason;         ///< of another status
  double prepare_limit_s = 0.0;
  double budget_s = 0.0;  ///< for its timing

  std::uint64_t points = 0;        ///< given to the renderer, after thinning
  std::uint64_t scene_points = 0;  ///< the scene's, the reference for memory
  std::optional<Measured> prepare_ms;
  std::uint64_t preparations = 0;  ///< the number is their median, the interval their extremes
  bool from_cache = false;         ///< part of the preparation came from a cache: incomparable
  std::optional<Measured> frame_mean_us, frame_p999_us;  ///< over all frames
  std::optional<Measured> load_percent;                  ///< of one processor: mean frame times rate
  std::uint64_t passes = 0;
  /// Mean frame of a fixed setting timed in turns with this one; its difference between rows shows the
  /// machine's drift.
  std::optional<double> anchor_us;
  std::optional<std::uint64_t> bytes;
  std::optional<Measured> error_p95_percent;  ///< as metrics::Accuracy::force_p95_percent, by episodes
  std::optional<double> error_rms_percent, error_floor_percent;
  std::optional<double> indistinguishable_percent;
  std::string trace_hash;
  double steal_percent = 0.0, load_before = 0.0;
  std::string measured_utc;

  [[nodiscard]] bool ok() const { return status == "ok"; }
  [[nodiscard]] double bytes_per_point() const {
    return scene_points > 0 && bytes ? static_cast<double>(*bytes) / static_cast<double>(scene_points) : 0.0;
  }
};

/// The measurements as a JSON object for rows.jsonl and documents, without schema, experiment and machine.
[[nodiscard]] std::string measured_text(const Row& row);
/// One line without its end: measured_text() with schema, experiment and machine.
[[nodiscard]] std::string row_text(const Row& row);
/// Parses every line of `text`. Error: an invalid line, with number and remedy.
[[nodiscard]] Result<std::vector<Row>> rows_of(std::string_view text, const std::string& file);
[[nodiscard]] Result<std::vector<Row>> read_rows(const std::string& file);
[[nodiscard]] std::string rows_text(const std::vector<Row>& rows);

// Dominated settings: another is as good in everything and better in something.

/// Costs weighed against the error.
enum class Cost { kSpeed, kMemory, kPreparation };
inline constexpr std::array<Cost, 3> kCosts = {Cost::kSpeed, Cost::kMemory, Cost::kPreparation};
/// "speed", "memory", "preparation".
[[nodiscard]] const char* name_of(Cost cost) noexcept;
/// The cost's number; empty if incomparable (a mesh from a cache).
[[nodiscard]] std::optional<Measured> cost_of(const Row& row, Cost cost);

/// True beyond both intervals and beyond `slack` (0.1: a tenth).
[[nodiscard]] bool surely_less(const Measured& a, const Measured& b, double slack = 0.0) noexcept;

struct Standing {
  bool dominated = false;
  std::string by;               ///< an undominated row that dominates it, directly or through others; empty:
                                ///< not dominated
  std::vector<Cost> on_fronts;  ///< fronts of cost and error on which it is undominated
};

/// Standings of all rows; rows that are not ok get none. O(n^2). Row a dominates row b of the same machine if
/// it is surely worse in none of load, longest frames (p99.9), memory, preparation and error, surely better
/// in one, and better on the whole (product of ratios). The last rule prevents two rows from dominating each
/// other by way of a third. The error may also not be worse by more than kSameError, sure or not: the frames
/// are equal, and an interval over few episodes would let a cheap setting win. "Surely" means beyond both
/// intervals; for times also beyond the anchors' difference, for single preparations beyond kOncePrepared.
[[nodiscard]] std::vector<Standing> standings_of(const std::vector<Row>& rows);

/// Errors over the same frames that differ by less count as equal. A choice, not a measurement.
inline constexpr double kSameError = 0.05;

/// Assumed deviation of a single preparation from the median of several. A choice, not a measurement: on a
/// busy machine three preparations of a small model differed by more.
inline constexpr double kOncePrepared = 0.2;

}  // namespace palpate::experiments
