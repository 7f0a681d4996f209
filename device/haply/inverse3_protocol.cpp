#include "device/haply/inverse3_device.h"

#include <nlohmann/json.hpp>

namespace palpate::device {
namespace {

using ServiceJson = nlohmann::json;

constexpr double kMmPerM = 1000.0;

/// Member of an object; null if absent or not an object.
const ServiceJson* member(const ServiceJson* of, const char* name) {
  if (of == nullptr || !of->is_object()) return nullptr;
  const auto at = of->find(name);
  return at == of->end() ? nullptr : &*at;
}

/// First object of a list; null if absent.
const ServiceJson* first_of(const ServiceJson* list) {
  return list != nullptr && list->is_array() && !list->empty() ? &list->front() : nullptr;
}

bool read_vector(const ServiceJson* from, Vec3& into) {
  const char* const names[] = {"x", "y", "z"};
  Vec3 read = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const ServiceJson* number = member(from, names[axis]);
    if (number == nullptr || !number->is_number()) return false;
    read[axis] = number->get<double>();
  }
  if (!is_finite(read)) return false;
  into = read;
  return true;
}

std::uint32_t buttons_of(const ServiceJson& whole) {
  std::uint32_t bits = 0;
  const char* const names[] = {"a", "b", "c"};
  for (const char* grip : {"wireless_verse_grip", "verse_grip"}) {
    const ServiceJson* const state = member(first_of(member(&whole, grip)), "state");
    const ServiceJson* const buttons = member(state, "buttons");
    for (unsigned i = 0; i < std::size(names); ++i) {
      const ServiceJson* const button = member(buttons, names[i]);
      if (button != nullptr && button->is_boolean() && button->get<bool>()) bits |= 1U << i;
    }
    const ServiceJson* const only = member(state, "button");
    if (only != nullptr && only->is_boolean() && only->get<bool>()) bits |= 1U;
  }
  return bits;
}

std::string command_text(const std::string& device_id, const char* section, ServiceJson what) {
  ServiceJson one = {{"device_id", device_id}};
  one[section] = std::move(what);
  // Replaces invalid UTF-8 in a service's id, which would throw otherwise.
  return ServiceJson{{"inverse3", ServiceJson::array({std::move(one)})}}.dump(
      -1, ' ', false, ServiceJson::error_handler_t::replace);
}

}  // namespace

Inverse3Text parsed_inverse3(std::string_view text, const std::string& wanted_id) {
  Inverse3Text read;
  constexpr bool kThrows = false;
  // Nesting is bounded: the library recurses only when destroying, and a text has at most 64 KB.
  const ServiceJson whole = ServiceJson::parse(text, nullptr, kThrows);
  if (whole.is_discarded() || !whole.is_object()) return read;
  read.is_json = true;
  const ServiceJson* const list = member(&whole, "inverse3");
  if (list == nullptr || !list->is_array()) return read;
  read.devices = static_cast<int>(list->size());
  for (const ServiceJson& one : *list) {
    const ServiceJson* const id = member(&one, "device_id");
    if (id == nullptr || !id->is_string()) continue;
    if (!wanted_id.empty() && id->get_ref<const std::string&>() != wanted_id) continue;
    read.has_device = true;
    read.device_id = id->get<std::string>();
    Vec3 position_m;
    read.has_position = read_vector(member(member(&one, "state"), "cursor_position"), position_m);
    if (read.has_position) read.position_mm = kMmPerM * position_m;
    read.has_position = read.has_position && is_finite(read.position_mm);
    if (!read.has_position) read.position_mm.setZero();
    if (const ServiceJson* const config = member(&one, "config"))
      read.config = config->dump(-1, ' ', false, ServiceJson::error_handler_t::replace);
    break;
  }
  read.buttons = buttons_of(whole);
  return read;
}

std::string inverse3_force_text(const std::string& device_id, const Vec3& force_n) {
  const Vec3 sent_n = is_finite(force_n) ? force_n : Vec3(Vec3::Zero());
  return command_text(
      device_id, "commands",
      {{"set_cursor_force", {{"values", {{"x", sent_n.x()}, {"y", sent_n.y()}, {"z", sent_n.z()}}}}}});
}

std::string inverse3_gate_text(const std::string& device_id, double gain) {
  return command_text(device_id, "configure", {{"force_gate", {{"gain", gain}}}});
}

std::string inverse3_scaling_body(bool on) {
  return ServiceJson{{"enabled", on}}.dump();
}

}  // namespace palpate::device
