#include "toolkit/io/las_unit.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "toolkit/core/bytes.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

// GeoTIFF keys and their values, by number (OGC 19-008, EPSG's units of measure).
constexpr std::uint16_t kModelTypeKey = 1024, kLinearUnitKey = 3076, kVerticalUnitKey = 4099;
constexpr std::uint16_t kGeographicModel = 2;
struct EpsgUnit {
  std::uint16_t code;
  double metres;
};
constexpr double kFoot = 0.3048, kUsSurveyFoot = 1200.0 / 3937.0;
constexpr EpsgUnit kEpsgUnits[] = {{9001, 1.0},   {9002, kFoot}, {9003, kUsSurveyFoot},
                                   {1025, 0.001}, {1033, 0.01},  {9036, 1000.0}};

struct KnownLength {
  double metres;
  std::optional<Unit> unit;
  const char* name;
};
constexpr KnownLength kKnownLengths[] = {
    {1.0, Unit::kMetre, "metres"},
    {0.01, Unit::kCentimetre, "centimetres"},
    {0.001, Unit::kMillimetre, "millimetres"},
    {0.0254, Unit::kInch, "inches"},
    {kFoot, std::nullopt, "feet"},
    {kUsSurveyFoot, std::nullopt, "US survey feet"},
};
// The two feet differ by 2e-6 of their length; texts give at least eight digits.
constexpr double kSameLength = 2e-7;

bool same_length(double a, double b) {
  return std::abs(a - b) <= kSameLength * b;
}

// What the file says, whichever way it says it.
struct StatedUnit {
  std::optional<double> metres, vertical_metres;
  bool geographic = false;
};

StatedUnit stated_by_keys(std::span<const std::byte> keys) {
  StatedUnit stated;
  ByteReader in(keys);
  (void)in.u16();  // versions of the directory, the keys and their revision
  (void)in.u32();
  const std::uint16_t count = in.u16();
  for (std::uint16_t i = 0; i < count; ++i) {
    const std::uint16_t key = in.u16(), elsewhere = in.u16();
    (void)in.u16();  // count of values
    const std::uint16_t value = in.u16();
    if (!in.good()) break;
    if (elsewhere != 0) continue;
    if (key == kModelTypeKey) stated.geographic = value == kGeographicModel;
    if (key != kLinearUnitKey && key != kVerticalUnitKey) continue;
    for (const EpsgUnit& unit : kEpsgUnits)
      if (unit.code == value) (key == kLinearUnitKey ? stated.metres : stated.vertical_metres) = unit.metres;
  }
  return stated;
}

template <std::size_t N>
bool is_one_of(std::string_view word, const std::array<std::string_view, N>& words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}
constexpr std::array<std::string_view, 7> kHorizontalSystems{
    "PROJCS", "PROJCRS", "PROJECTEDCRS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS"};
constexpr std::array<std::string_view, 4> kVerticalSystems{"VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"};
constexpr std::array<std::string_view, 5> kGeographicSystems{"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS",
                                                             "GEODETICCRS"};
constexpr std::array<std::string_view, 2> kAxisWords{"CS", "AXIS"};
constexpr std::array<std::string_view, 2> kUnitWords{"UNIT", "LENGTHUNIT"};

StatedUnit stated_by_text(std::string_view text) {
  StatedUnit stated;
  stated.metres = metres_of_text(text, false);
  stated.vertical_metres = metres_of_text(text, true);
  const auto holds = [&](std::string_view word) { return text.find(word) != std::string_view::npos; };
  stated.geographic = std::any_of(kGeographicSystems.begin(), kGeographicSystems.end(), holds) &&
                      std::none_of(kHorizontalSystems.begin(), kHorizontalSystems.end(), holds);
  return stated;
}

bool states_something(const StatedUnit& stated) {
  return stated.metres || stated.geographic;
}

}  // namespace

std::optional<double> metres_of_text(std::string_view text, bool vertical) {
  // Words with brackets, from the outermost one to where `at` stands.
  struct Open {
    std::string_view word;
    int commas = 0;
  };
  constexpr std::size_t kDeepest = 32;  // real texts reach eight
  std::vector<Open> open;
  const auto is_letter = [](char c) { return (c >= 'A' && c <= 'Z') || c == '_'; };
  const auto ends_number = [](char c) { return c == ',' || c == ']' || c == ')' || c == ' ' || c == '\n'; };
  std::size_t at = 0;
  while (at < text.size()) {
    const char c = text[at];
    if (c == '"') {
      at = text.find('"', at + 1);
      if (at == std::string_view::npos) return std::nullopt;
      ++at;
    } else if (is_letter(c)) {
      const std::size_t begin = at;
      while (at < text.size() && (is_letter(text[at]) || (text[at] >= '0' && text[at] <= '9'))) ++at;
      if (at < text.size() && (text[at] == '[' || text[at] == '(')) {
        if (open.size() == kDeepest) return std::nullopt;
        open.push_back({text.substr(begin, at - begin), 0});
        ++at;
      }
    } else if (c == ']' || c == ')') {
      if (!open.empty()) open.pop_back();
      ++at;
    } else if (c == ',') {
      if (!open.empty()) ++open.back().commas;
      ++at;
    } else if (open.size() > 1 && open.back().commas == 1 && is_one_of(open.back().word, kUnitWords) &&
               !is_blank(c) && c != '\n') {
      std::size_t end = at;
      while (end < text.size() && !ends_number(text[end])) ++end;
      // Units of axes are those of their system; those of anything else in it (a parameter) are their own.
      auto owner = open.rbegin() + 1;
      while (owner != open.rend() && is_one_of(owner->word, kAxisWords)) ++owner;
      const bool wanted = owner != open.rend() && (vertical ? is_one_of(owner->word, kVerticalSystems)
                                                            : is_one_of(owner->word, kHorizontalSystems));
      const std::optional<double> metres = parse_real(text.substr(at, end - at));
      if (wanted && metres && *metres > 0.0 && std::isfinite(*metres)) return metres;
      at = std::max(end, at + 1);
    } else {
      ++at;
    }
  }
  return std::nullopt;
}

LasUnit unit_of_las(std::span<const std::byte> keys, std::string_view text, bool prefers_text) {
  const StatedUnit by_text = stated_by_text(text), by_keys = stated_by_keys(keys);
  const auto& [first, second] = prefers_text ? std::tie(by_text, by_keys) : std::tie(by_keys, by_text);
  const StatedUnit& stated = states_something(first) ? first : second;
  LasUnit found;
  found.conventional_unit = Unit::kMetre;
  if (!stated.metres && stated.geographic) {
    found.warnings.emplace_back(
        "The file's positions are longitudes and latitudes in degrees, beside heights in a length: their "
        "shape is not that of the scanned thing. Project it first: pdal translate in out --filters "
        "filters.reprojection --filters.reprojection.out_srs=EPSG:CODE.");
    return found;
  }
  if (!stated.metres) return found;
  const auto* const known =
      std::find_if(std::begin(kKnownLengths), std::end(kKnownLengths),
                   [&](const KnownLength& length) { return same_length(length.metres, *stated.metres); });
  const std::string name = known != std::end(kKnownLengths) ? known->name : "another unit";
  if (known != std::end(kKnownLengths) && known->unit) {
    found.unit = known->unit;
  } else {
    found.warnings.push_back(fmt::format(
        "The file's lengths are in {}, {:.12g} m each, and are read as metres: for their true size "
        "read it with --unit m and multiply --scale by {:.12g}.",
        name, *stated.metres, *stated.metres));
  }
  if (stated.vertical_metres && !same_length(*stated.vertical_metres, *stated.metres))
    found.warnings.push_back(fmt::format(
        "The file's heights are in a unit of {:.12g} m, its x and y in one of {:.12g} m: heights are "
        "read in the unit of x and y.",
        *stated.vertical_metres, *stated.metres));
  return found;
}

}  // namespace palpate::io
