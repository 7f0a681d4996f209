// Options of a renderer, generator or reconstruction: names with values, the same on the command line
// ("name:key=value:key=value") and in a scene file (one key a line). Values stay text until a typed getter
// reads them, after validate() has checked every one against its OptionSpec.
#pragma once

#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate {

enum class OptionKind { kText, kNumber, kInteger, kFlag, kChoice };

/// Where a number may lie. Ends of 1e300 and beyond are no bounds.
struct NumberRange {
  double low = -1e300, high = 1e300;
  bool above_low = false;  ///< `low` itself lies outside
};
/// "above 0", "at least 2", "from 0 to 4096"; empty where there is no bound.
[[nodiscard]] std::string text_of(const NumberRange& range);

/// The one way in which a number is read that a person gave: the whole text, finite, in range. The Error says
/// what of this it is not, with the text in short.
[[nodiscard]] Result<double> read_number(std::string_view text, const NumberRange& range);
[[nodiscard]] Result<long long> read_integer(std::string_view text, const NumberRange& range);

/// Another option of the same owner, and the values of it with which an option acts.
struct OptionCondition {
  std::string key;
  std::vector<std::string> values{};  ///< empty: any but its default
  bool except = false;                ///< any but these
};

/// One option that something understands.
struct OptionSpec {
  std::string key;
  OptionKind kind = OptionKind::kText;
  std::string default_value;
  std::string help;                    ///< one line, with the unit
  std::vector<std::string> choices{};  ///< for kChoice
  double low = -1e300;                 ///< for kNumber and kInteger, inclusive
  double high = 1e300;
  /// Where the option acts: all of these hold. Given where it does not, with a value that is not its default,
  /// it is refused.
  std::vector<OptionCondition> only_with{};
};

class Options {
 public:
  void set(std::string key, std::string value) { values_[std::move(key)] = std::move(value); }
  [[nodiscard]] bool has(std::string_view key) const { return values_.find(key) != values_.end(); }
  /// The getters need a validated set: a key that is not there or not of the kind is a programming error.
  [[nodiscard]] const std::string& text(std::string_view key) const;
  [[nodiscard]] double number(std::string_view key) const;
  [[nodiscard]] long long integer(std::string_view key) const;
  [[nodiscard]] bool flag(std::string_view key) const;
  [[nodiscard]] const std::map<std::string, std::string, std::less<>>& all() const { return values_; }

 private:
  std::map<std::string, std::string, std::less<>> values_;
};

/// "name:key=value:key" split into its name and options; a key without a value means "true".
struct NamedOptions {
  std::string name;
  Options options;
};
[[nodiscard]] Result<NamedOptions> parse_named_options(std::string_view text);

/// Splits "a,b:x=1,c" at commas.
[[nodiscard]] std::vector<std::string> split_list(std::string_view text, char separator = ',');

/// `given` completed by the defaults of `specs`. Unknown keys, wrong kinds, values out of range and options
/// that would do nothing beside the others are errors that name what would be understood. `owner` is the name
/// used in messages.
[[nodiscard]] Result<Options> validate(const Options& given, std::span<const OptionSpec> specs,
                                       std::string_view owner);

/// Whether option `key` is one of `specs` and does something beside those given and the defaults.
[[nodiscard]] bool option_acts(std::string_view key, const Options& given, std::span<const OptionSpec> specs);

/// Whole-string conversions; nothing, blanks or trailing text is an error. "nan" and "inf" are numbers here.
[[nodiscard]] Result<double> parse_number(std::string_view text);
[[nodiscard]] Result<long long> parse_integer(std::string_view text);

}  // namespace palpate
