// What was measured of one setting on one machine: a row of rows.jsonl, a line of JSON each. Rows are the raw
// data of every sweep: they are kept, merged and drawn, and never changed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "toolkit/core/bootstrap.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

inline constexpr const char* kRowsFile = "rows.jsonl";
/// A row has some 1,500 bytes: so many hold a hundred thousand.
inline constexpr std::uint64_t kMostRowsBytes = std::uint64_t{1} << 28;

/// Times are comparable among rows of one and the same machine, and of nothing else.
struct RowMachine {
  std::string name;  ///< of the host
  std::string cpu;   ///< the processor's name
  std::string hash;  ///< of both, its cores and its kernel: what "the same machine" means
  int cores = 0;
};
[[nodiscard]] RowMachine this_machine();

/// A number with the interval it lies in; without one the number is exact.
struct Measured {
  double value = 0.0;
  std::optional<Interval> interval{};
  [[nodiscard]] double low() const noexcept { return interval ? interval->low : value; }
  [[nodiscard]] double high() const noexcept { return interval ? interval->high : value; }
};

struct Row {
  std::string setting;     ///< Setting::text
  std::string experiment;  ///< of scene, path, truth and program: rows of two never meet
  RowMachine machine;
  std::string renderer;                                      ///< its name in the registry
  std::string works_on;                                      ///< points, mesh, heights
  std::vector<std::pair<std::string, std::string>> options;  ///< as given, and "clean"
  std::vector<std::string> axes;                             ///< where it is not as usual
  int precision_bits = 0;
  int rate_divisor = 1;
  double rate_hz = 0.0;
  std::string status = "ok";  ///< or "did-not-finish", "failed"
  std::string reason;         ///< why not
  double prepare_limit_s = 0.0;
  double budget_s = 0.0;  ///< that its timing had

  std::uint64_t points = 0;        ///< that the renderer got, after thinning
  std::uint64_t scene_points = 0;  ///< of the scene: memory is counted by these
  std::optional<Measured> prepare_ms;
  std::uint64_t preparations = 0;  ///< the number is their median, the interval their extremes
  bool from_cache = false;         ///< a part of the preparation came from a cache: not to be compared
  std::optional<Measured> frame_mean_us, frame_p999_us;  ///< over all frames
  std::optional<Measured> load_percent;                  ///< of one processor: mean frame times rate
  std::uint64_t passes = 0;
  /// Mean frame of one and the same setting, timed in turns with this one: by how much it differs between two
  /// rows, their times are not comparable.
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

/// What was measured, as a JSON object: what stands in rows.jsonl and in documents alike. Those say beside it
/// which schema, experiment and machine it is of.
[[nodiscard]] std::string measured_text(const Row& row);
/// One line, without its end: the same with schema, experiment and machine.
[[nodiscard]] std::string row_text(const Row& row);
/// Every line of `text`. A line that is no row is an Error with its number and what to do.
[[nodiscard]] Result<std::vector<Row>> rows_of(std::string_view text, const std::string& file);
[[nodiscard]] Result<std::vector<Row>> read_rows(const std::string& file);
[[nodiscard]] std::string rows_text(const std::vector<Row>& rows);

}  // namespace palpate::experiments
