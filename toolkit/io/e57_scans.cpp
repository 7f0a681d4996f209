#include "toolkit/io/e57_scans.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <pugixml.hpp>

#include "toolkit/core/messages.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

constexpr const char* kExportE57 = "export it again with another program, or as PLY";

Error bad_xml(std::string what) {
  return Error{fmt::format("the E57 file's XML is not understood: {}", what), kExportE57};
}

// An element without text holds the standard's default, 0.
Result<double> number_in(const pugi::xml_node& node) {
  const std::string_view text = trimmed(node.child_value());
  if (text.empty()) return 0.0;
  const std::optional<double> value = parse_real(text);
  if (!value) return bad_xml(fmt::format("{} in <{}> is not a number", shown(text), node.name()));
  return *value;
}

// An attribute, or `otherwise` where it is left out.
Result<double> real_attribute(const pugi::xml_node& node, const char* name, double otherwise) {
  const pugi::xml_attribute attribute = node.attribute(name);
  if (!attribute) return otherwise;
  const std::optional<double> value = parse_real(trimmed(attribute.value()));
  if (!value || !std::isfinite(*value))
    return bad_xml(
        fmt::format("the {} of <{}> is {}, no number", name, node.name(), shown(attribute.value())));
  return *value;
}

Result<std::int64_t> whole_attribute(const pugi::xml_node& node, const char* name, std::int64_t otherwise) {
  const pugi::xml_attribute attribute = node.attribute(name);
  if (!attribute) return otherwise;
  const std::optional<std::int64_t> value = parse_whole(trimmed(attribute.value()));
  if (!value)
    return bad_xml(
        fmt::format("the {} of <{}> is {}, no whole number", name, node.name(), shown(attribute.value())));
  return *value;
}

// A count or an offset, which must be there.
Result<std::uint64_t> count_attribute(const pugi::xml_node& node, const char* name) {
  constexpr std::int64_t kMissing = -1;
  PALPATE_ASSIGN(const std::int64_t value, whole_attribute(node, name, kMissing));
  if (value < 0) return bad_xml(fmt::format("<{}> has no {} that is a count", node.name(), name));
  return static_cast<std::uint64_t>(value);
}

std::string_view type_of(const pugi::xml_node& node) {
  return node.attribute("type").value();
}

Result<E57Field> parse_field(const pugi::xml_node& node) {
  E57Field field;
  field.name = node.name();
  const std::string_view type = type_of(node);
  if (type == "Float") {
    const std::string_view precision = node.attribute("precision").as_string("double");
    if (precision != "single" && precision != "double")
      return bad_xml(fmt::format("the precision {} of the field {}", shown(precision), shown(field.name)));
    field.type = precision == "single" ? E57Type::kSingle : E57Type::kDouble;
    field.bits = precision == "single" ? 32 : 64;  // of an IEEE 754 number
  } else if (type == "Integer" || type == "ScaledInteger") {
    field.type = type == "Integer" ? E57Type::kInteger : E57Type::kScaledInteger;
    PALPATE_ASSIGN(field.minimum, whole_attribute(node, "minimum", std::numeric_limits<std::int64_t>::min()));
    PALPATE_ASSIGN(const std::int64_t maximum,
                   whole_attribute(node, "maximum", std::numeric_limits<std::int64_t>::max()));
    if (maximum < field.minimum)
      return bad_xml(fmt::format("the field {} has the minimum {} and the maximum {}", shown(field.name),
                                 field.minimum, maximum));
    // The difference of two 64-bit numbers fits a word without sign, and so many bits hold every value.
    field.bits = static_cast<unsigned>(
        std::bit_width(static_cast<std::uint64_t>(maximum) - static_cast<std::uint64_t>(field.minimum)));
    if (field.type == E57Type::kScaledInteger) {
      PALPATE_ASSIGN(field.scale, real_attribute(node, "scale", 1.0));
      PALPATE_ASSIGN(field.offset, real_attribute(node, "offset", 0.0));
    }
  } else if (type == "String") {
    field.type = E57Type::kText;
  } else {
    return bad_xml(fmt::format("the field {} of a record has the type {}", shown(field.name), shown(type)));
  }
  return field;
}

// Bit packing is the one codec of the standard; a file that names no codec has it too.
Status check_codecs(const pugi::xml_node& codecs, const std::string& scan) {
  for (const pugi::xml_node& codec : codecs.children())
    for (const pugi::xml_node& part : codec.children()) {
      const std::string_view name = part.name();
      if (part.type() == pugi::node_element && name != "inputs" && name != "bitPackCodec")
        return Error{fmt::format("the codec {} of {} is not read", shown(name), scan), kExportE57};
    }
  return Done{};
}

Result<Vec3> vector_in(const pugi::xml_node& node, const char* x, const char* y, const char* z) {
  Vec3 vector;
  PALPATE_ASSIGN(vector.x(), number_in(node.child(x)));
  PALPATE_ASSIGN(vector.y(), number_in(node.child(y)));
  PALPATE_ASSIGN(vector.z(), number_in(node.child(z)));
  return vector;
}

Status parse_pose(const pugi::xml_node& pose, E57Scan& scan) {
  if (const pugi::xml_node rotation = pose.child("rotation")) {
    PALPATE_ASSIGN(const double w, number_in(rotation.child("w")));
    PALPATE_ASSIGN(const Vec3 v, vector_in(rotation, "x", "y", "z"));
    const Eigen::Quaterniond quaternion(w, v.x(), v.y(), v.z());
    // The standard asks for length 1; writers round to four digits at worst, and what is far from it is no
    // rotation at all.
    constexpr double kLengthSlack = 1e-3;
    if (!(std::abs(quaternion.norm() - 1.0) <= kLengthSlack))
      return Error{fmt::format("the rotation of {} is no unit quaternion: {:g}, {:g}, {:g}, {:g}", scan.name,
                               w, v.x(), v.y(), v.z()),
                   kExportE57};
    scan.rotation = quaternion.normalized().toRotationMatrix();
  }
  if (const pugi::xml_node translation = pose.child("translation")) {
    PALPATE_ASSIGN(scan.translation, vector_in(translation, "x", "y", "z"));
    if (!is_finite(scan.translation))
      return Error{fmt::format("the translation of {} is not finite", scan.name), kExportE57};
  }
  return Done{};
}

// The box of the turned box. Stated limits only guide a reader: strange ones are left out, not refused.
std::optional<geometry::Aabb> parse_bounds(const pugi::xml_node& bounds, const E57Scan& scan) {
  if (!bounds) return std::nullopt;
  const Result<Vec3> low = vector_in(bounds, "xMinimum", "yMinimum", "zMinimum"),
                     high = vector_in(bounds, "xMaximum", "yMaximum", "zMaximum");
  if (!low || !high || !is_finite(*low) || !is_finite(*high) || (low->array() > high->array()).any())
    return std::nullopt;
  geometry::Aabb box;
  constexpr unsigned kCorners = 8;
  for (unsigned c = 0; c < kCorners; ++c) {
    const Vec3 corner((c & 1u) != 0 ? high->x() : low->x(), (c & 2u) != 0 ? high->y() : low->y(),
                      (c & 4u) != 0 ? high->z() : low->z());
    const Vec3 placed = scan.rotation * corner + scan.translation;
    if (!is_finite(placed)) return std::nullopt;
    box.add(placed);
  }
  return box;
}

Result<E57Scan> parse_scan(const pugi::xml_node& node, std::size_t number) {
  E57Scan scan;
  scan.name = fmt::format("scan {}", number);
  if (const std::string_view name = trimmed(node.child("name").child_value()); !name.empty())
    scan.name += fmt::format(" ({})", shown(name));
  const pugi::xml_node points = node.child("points");
  if (!points) return bad_xml(fmt::format("{} has no points", scan.name));
  if (type_of(points) != "CompressedVector")
    return bad_xml(fmt::format("the points of {} have the type {}", scan.name, shown(type_of(points))));
  PALPATE_ASSIGN(scan.records, count_attribute(points, "recordCount"));
  PALPATE_ASSIGN(scan.section, count_attribute(points, "fileOffset"));
  PALPATE_TRY(check_codecs(points.child("codecs"), scan.name));
  for (const pugi::xml_node& child : points.child("prototype").children()) {
    if (child.type() != pugi::node_element) continue;
    PALPATE_ASSIGN(E57Field field, parse_field(child));
    if (scan.find(field.name))
      return bad_xml(fmt::format("the field {} of {} stands twice", shown(field.name), scan.name));
    scan.fields.push_back(std::move(field));
    // The standard and its known extensions name some 40; finding one by name goes through them all.
    constexpr std::size_t kMostFields = 256;
    if (scan.fields.size() > kMostFields)
      return bad_xml(fmt::format("{} has more than {} fields", scan.name, kMostFields));
  }
  PALPATE_TRY(parse_pose(node.child("pose"), scan));
  scan.bounds = parse_bounds(node.child("cartesianBounds"), scan);
  return scan;
}

}  // namespace

std::optional<std::size_t> E57Scan::find(std::string_view field) const noexcept {
  const auto found =
      std::find_if(fields.begin(), fields.end(), [&](const E57Field& f) { return f.name == field; });
  if (found == fields.end()) return std::nullopt;
  return static_cast<std::size_t>(found - fields.begin());
}

Result<std::vector<E57Scan>> parse_e57_scans(std::string_view xml) {
  pugi::xml_document document;
  const pugi::xml_parse_result parsed =
      document.load_buffer(xml.data(), xml.size(), pugi::parse_default, pugi::encoding_utf8);
  if (!parsed) {
    const std::string_view before = xml.substr(
        0, std::min(xml.size(), static_cast<std::size_t>(std::max<std::ptrdiff_t>(parsed.offset, 0))));
    return bad_xml(fmt::format("{}, in its line {}", parsed.description(),
                               std::count(before.begin(), before.end(), '\n') + 1));
  }
  const pugi::xml_node root = document.child("e57Root");
  if (!root) return bad_xml("it has no <e57Root>");
  std::vector<E57Scan> scans;
  for (const pugi::xml_node& child : root.child("data3D").children()) {
    if (child.type() != pugi::node_element) continue;
    PALPATE_ASSIGN(E57Scan scan, parse_scan(child, scans.size() + 1));
    scans.push_back(std::move(scan));
  }
  return scans;
}

}  // namespace palpate::io
