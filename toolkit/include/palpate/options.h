// Options of a renderer, generator or reconstruction: named text values, from the command line
// ("name:key=value:key=value") or a scene file (one key a line). validate() checks each against its
// OptionSpec; typed getters read them afterwards.
//
// First:
//   const auto spec = palpate::parse_named_options("cloud:shading=none");
//   if (!spec) return failed(spec.error());
//   auto renderer = registry.make(spec->name, spec->options);
#pragma once

#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>

namespace palpate {

enum class OptionKind { kText, kNumber, kInteger, kFlag, kChoice };

/// The allowed range of a number. Limits of 1e300 and beyond mean unbounded.
struct NumberRange {
  double low = -1e300, high = 1e300;
  bool above_low = false;  ///< `low` itself is excluded
};
/// "above 0", "at least 2", "from 0 to 4096"; empty if unbounded.
[[nodiscard]] std::string text_of(const NumberRange& range);

/// Reads a number that a user gave: the whole text, finite, in range. The Error quotes the text and says
/// which rule it breaks. All user input goes through here.
[[nodiscard]] Result<double> read_number(std::string_view text, const NumberRange& range);
[[nodiscard]] Result<long long> read_integer(std::string_view text, const NumberRange& range);

/// Values of another option of the same owner under which an option has an effect.
struct OptionCondition {
  std::string key;
  std::vector<std::string> values{};  ///< empty: any value but its default
  bool except = false;                ///< any value but these
};

/// One known option.
struct OptionSpec {
  std::string key;
  OptionKind kind = OptionKind::kText;
  std::string default_value;
  std::string help;                    ///< one line, with the unit
  std::vector<std::string> choices{};  ///< for kChoice
  double low = -1e300;                 ///< for kNumber and kInteger, inclusive
  double high = 1e300;
  /// Conditions that must all hold for the option to act. A non-default value is refused where they do not.
  std::vector<OptionCondition> only_with{};
};

class Options {
 public:
  void set(std::string key, std::string value) { values_[std::move(key)] = std::move(value); }
  [[nodiscard]] bool has(std::string_view key) const { return values_.find(key) != values_.end(); }
  /// Getters need a validated set: a missing key or a wrong kind is a programming error.
  [[nodiscard]] const std::string& text(std::string_view key) const;
  [[nodiscard]] double number(std::string_view key) const;
  [[nodiscard]] long long integer(std::string_view key) const;
  [[nodiscard]] bool flag(std::string_view key) const;
  [[nodiscard]] const std::map<std::string, std::string, std::less<>>& all() const { return values_; }

 private:
  std::map<std::string, std::string, std::less<>> values_;
};

/// "name:key=value:key" split into name and options; a key without a value means "true".
struct NamedOptions {
  std::string name;
  Options options;
};
[[nodiscard]] Result<NamedOptions> parse_named_options(std::string_view text);

/// Splits "a,b:x=1,c" at commas.
[[nodiscard]] std::vector<std::string> split_list(std::string_view text, char separator = ',');

/// `given` completed by the defaults of `specs`. Errors name what is understood: unknown keys, wrong kinds,
/// values out of range, options without effect. `owner` is the name used in messages.
[[nodiscard]] Result<Options> validate(const Options& given, std::span<const OptionSpec> specs,
                                       std::string_view owner);

/// True if `key` is in `specs` and has an effect with `given` and the defaults.
[[nodiscard]] bool option_applies(std::string_view key, const Options& given,
                                  std::span<const OptionSpec> specs);

/// Convert the whole text; empty text, blanks or trailing characters are an Error. "nan" and "inf" are
/// accepted.
[[nodiscard]] Result<double> parse_number(std::string_view text);
[[nodiscard]] Result<long long> parse_integer(std::string_view text);

/// The condition in words: "method=grid", "method other than none", "jitter".
[[nodiscard]] std::string text_of(const OptionCondition& condition);

}  // namespace palpate
