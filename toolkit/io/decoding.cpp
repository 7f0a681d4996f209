#include "toolkit/io/decoding.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace palpate::io {
namespace {

// from_chars leaves the value alone where it does not fit; what the text says decides between 0 and infinity.
double out_of_range(std::string_view token) noexcept {
  const bool negative = token.front() == '-';
  const std::size_t exponent = token.find_first_of("eE");
  bool tiny = false;
  if (exponent != std::string_view::npos) {
    tiny = exponent + 1 < token.size() && token[exponent + 1] == '-';
  } else {
    // Without an exponent: more than 308 digits before the point, or that many zeros after it.
    const std::string_view digits = token.substr(negative ? 1 : 0);
    tiny = digits.substr(0, digits.find('.')).find_first_of("123456789") == std::string_view::npos;
  }
  const double size = tiny ? 0.0 : std::numeric_limits<double>::infinity();
  return negative ? -size : size;
}

/// Points for which memory is reserved on the word of a header alone (24 MB); beyond that it grows with what
/// arrives.
constexpr std::uint64_t kMaxReservedPoints = std::uint64_t{1} << 20;

}  // namespace

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return lower;
}

std::optional<double> parse_real(std::string_view token) noexcept {
  if (token.size() > 1 && token.front() == '+' && token[1] != '-') token.remove_prefix(1);
  if (token.empty()) return std::nullopt;
  double value = 0;
  const char* const last = token.data() + token.size();
  const auto [end, code] = std::from_chars(token.data(), last, value);
  if (code == std::errc::result_out_of_range && end == last) return out_of_range(token);
  if (code != std::errc{}) return std::nullopt;
  if (end == last) return value;
  // "1.#QNAN", "-1.#IND", "1.#INF": from_chars stops at the '#'.
  if (*end == '#' && *(end - 1) == '.') {
    const std::string_view rest(end + 1, static_cast<std::size_t>(last - end) - 1);
    if (rest.starts_with("INF")) return std::copysign(std::numeric_limits<double>::infinity(), value);
    if (rest.starts_with("IND") || rest.starts_with("QNAN") || rest.starts_with("SNAN"))
      return std::numeric_limits<double>::quiet_NaN();
  }
  return std::nullopt;
}

std::optional<std::int64_t> parse_whole(std::string_view token) noexcept {
  if (token.size() > 1 && token.front() == '+' && token[1] != '-') token.remove_prefix(1);
  std::int64_t value = 0;
  const char* const last = token.data() + token.size();
  const auto [end, code] = std::from_chars(token.data(), last, value);
  if (code != std::errc{} || end != last) return std::nullopt;
  return value;
}

Result<Vec3> next_vertex(std::string_view& rest) {
  Vec3 point;
  for (int axis = 0; axis < 3; ++axis) {
    const std::string_view token = next_token(rest);
    if (token.empty())
      return Error{fmt::format("a vertex needs 3 coordinates, this one has {}", axis), kCheckLine};
    const std::optional<double> value = parse_real(token);
    if (!value)
      return Error{fmt::format("the coordinate {} is not a number", shown(token)),
                   number_remedy(token, kCheckLine)};
    point[axis] = *value;
  }
  return point;
}

float to_float(double value) noexcept {
  constexpr double kMost = static_cast<double>(std::numeric_limits<float>::max());
  if (value > kMost) return std::numeric_limits<float>::infinity();
  if (value < -kMost) return -std::numeric_limits<float>::infinity();
  return static_cast<float>(value);
}

std::size_t DecodedFile::bytes() const noexcept {
  std::size_t total = points.size() * sizeof(Vec3) + triangles.size() * sizeof(triangles[0]) +
                      position_of.size() * sizeof(position_of[0]);
  for (const cloud::Property& property : properties) total += property.values.size() * sizeof(float);
  return total;
}

Status check_memory(std::uint64_t count, std::uint64_t bytes_each, std::string_view what,
                    const ReadOptions& options) {
  if (count > kMaxPoints || (bytes_each > 0 && count > options.max_bytes / bytes_each))
    return over_memory_limit(fmt::format("the promised {} {}", count, what), options.max_bytes);
  return Done{};
}

std::size_t reserve_count(std::uint64_t count, std::uint64_t min_row_bytes,
                          std::optional<std::uint64_t> remaining) {
  const std::uint64_t justified =
      remaining ? *remaining / std::max<std::uint64_t>(1, min_row_bytes) + 1 : kMaxReservedPoints;
  return static_cast<std::size_t>(std::min(count, justified));
}

ReadMonitor::ReadMonitor(const ReaderInput& input, const BufferedInput& buffer, const DecodedFile& decoded)
    : input_(input), buffer_(buffer), decoded_(decoded) {}

bool ReadMonitor::check() {
  input_.progress.report("reading", buffer_.fraction());
  if (input_.progress.cancelled()) {
    error_ = Error{"reading was stopped"};
    return false;
  }
  if (decoded_.bytes() > input_.options.max_bytes) {
    error_ = over_memory_limit("the file's content", input_.options.max_bytes);
    return false;
  }
  return true;
}

FaceBuilder::FaceBuilder(DecodedFile& decoded, std::uint64_t index_limit, const ReadOptions& options)
    : decoded_(decoded),
      index_limit_(std::min(index_limit, kMaxPoints)),
      max_bytes_(options.max_bytes),
      max_triangles_(options.max_bytes / sizeof(decoded.triangles[0])) {}

void FaceBuilder::begin() noexcept {
  start_ = decoded_.triangles.size();
  corners_ = 0;
  bad_ = false;
}

bool FaceBuilder::corner(std::int64_t index) {
  if (index < 0 || static_cast<std::uint64_t>(index) >= index_limit_) bad_ = true;
  if (bad_) return true;
  const auto now = static_cast<std::uint32_t>(index);
  if (corners_ == 0) first_ = now;
  if (corners_ >= 2) {
    if (decoded_.triangles.size() >= max_triangles_) return false;
    decoded_.triangles.push_back({first_, last_, now});
    decoded_.continues_face.push_back(corners_ > 2);
  }
  last_ = now;
  ++corners_;
  return true;
}

void FaceBuilder::end() {
  constexpr std::uint64_t kMinCorners = 3;  // of a polygon
  if (!bad_ && corners_ >= kMinCorners) return;
  ++decoded_.dropped_faces;
  decoded_.triangles.resize(start_);
  decoded_.continues_face.resize(start_);
}

Error FaceBuilder::too_many() const {
  return over_memory_limit("the file's faces", max_bytes_);
}

}  // namespace palpate::io
