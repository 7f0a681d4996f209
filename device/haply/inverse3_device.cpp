#include "device/haply/inverse3_device.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include <palpate/result.h>
#include "device/interface/driver_options.h"
#include "device/links/udp_link.h"
#include "toolkit/core/messages.h"

namespace palpate::device {
namespace {

using ServiceJson = nlohmann::json;

constexpr double kMmPerM = 1000.0;

/// The value at a JSON pointer; null if there is none.
const ServiceJson* at(const ServiceJson& from, const std::string& pointer) {
  const ServiceJson::json_pointer where(pointer);
  return from.contains(where) ? &from.at(where) : nullptr;
}

bool read_vector(const ServiceJson& from, const std::string& pointer, Vec3& into) {
  Vec3 read = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const ServiceJson* const number = at(from, pointer + "/" + "xyz"[axis]);
    if (number == nullptr || !number->is_number()) return false;
    read[axis] = number->get<double>();
  }
  if (!is_finite(read)) return false;
  into = read;
  return true;
}

std::uint32_t buttons_of(const ServiceJson& whole) {
  constexpr auto kButtons = std::to_array<std::pair<const char*, std::uint32_t>>(
      {{"buttons/a", 1U}, {"buttons/b", 2U}, {"buttons/c", 4U}, {"button", 1U}});
  std::uint32_t bits = 0;
  for (const char* grip : {"/wireless_verse_grip", "/verse_grip"})
    for (const auto& [name, bit] : kButtons) {
      const ServiceJson* const button = at(whole, std::string(grip) + "/0/state/" + name);
      if (button != nullptr && button->is_boolean() && button->get<bool>()) bits |= bit;
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
  const ServiceJson* const list = at(whole, "/inverse3");
  if (list == nullptr || !list->is_array()) return read;
  read.devices = static_cast<int>(list->size());
  for (const ServiceJson& one : *list) {
    const ServiceJson* const id = at(one, "/device_id");
    if (id == nullptr || !id->is_string()) continue;
    if (!wanted_id.empty() && id->get_ref<const std::string&>() != wanted_id) continue;
    read.has_device = true;
    read.device_id = id->get<std::string>();
    Vec3 position_m = Vec3::Zero();
    read.has_position = read_vector(one, "/state/cursor_position", position_m);
    if (read.has_position) read.position_mm = kMmPerM * position_m;
    read.has_position = read.has_position && is_finite(read.position_mm);
    if (!read.has_position) read.position_mm.setZero();
    if (const ServiceJson* const config = at(one, "/config"))
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

namespace {

// Three in a row mean a broken connection.
constexpr int kMostNonsense = 3;
// Repeats the command after this time without an answer: four times within the silence limit.
constexpr std::int64_t kAskAgainNs = 5'000'000;

}  // namespace

void Inverse3Session::take(std::string_view text) noexcept {
  texts_.fetch_add(1);
  const std::string wanted = wanted_id_.empty() ? device_id() : wanted_id_;
  const Inverse3Text read = parsed_inverse3(text, wanted);
  if (!read.is_json || (read.has_device && !read.has_position)) {
    malformed_.store(std::min(malformed_.load() + 1, kMostNonsense));
    return;
  }
  malformed_.store(0);
  // A text without a device list is about something else.
  if (!read.has_device) {
    if (read.devices >= 0) present_.store(false);
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    device_id_ = read.device_id;
    if (!read.config.empty()) config_ = read.config;
  }
  answer_due_ = true;
  seen_.publish({read.position_mm, read.buttons, clock_.now_ns()});
  present_.store(true);
}

bool Inverse3Session::give(std::string& text) noexcept {
  const std::string id = device_id();
  if (id.empty()) return false;
  if (!gate_given_) {
    gate_given_ = true;
    text = inverse3_gate_text(id, force_gate_);
    return true;
  }
  const std::int64_t now_ns = monotonic_ns();
  const Vec3 force_n = force_.load();
  const bool is_zero_command = force_n.isZero(0.0) && !given_n_.isZero(0.0);
  if (!answer_due_ && !is_zero_command && now_ns - given_ns_ < kAskAgainNs) return false;
  answer_due_ = false;
  given_ns_ = now_ns;
  given_n_ = force_n;
  text = inverse3_force_text(id, force_n);
  if (force_n.isZero(0.0)) zero_given_.store(true);
  return true;
}

bool Inverse3Session::last(std::string& text) noexcept {
  const std::string id = device_id();
  if (id.empty()) return false;
  text = inverse3_force_text(id, Vec3::Zero());
  return true;
}

bool Inverse3Session::newest(Seen& seen) noexcept {
  const bool fresh = seen_.acquire();
  if (fresh) seen = seen_.front();
  return fresh;
}

std::string Inverse3Session::device_id() const {
  const std::lock_guard lock(mutex_);
  return device_id_;
}

std::string Inverse3Session::config() const {
  const std::lock_guard lock(mutex_);
  return config_;
}

Inverse3Device::Inverse3Device(std::unique_ptr<TextLink> link, const Clock& clock, Inverse3Options options)
    : link_(std::move(link)), clock_(clock), options_(std::move(options)) {}

Status Inverse3Device::open() {
  close();
  talks_.push_back(std::make_unique<Inverse3Session>(clock_, options_.device_id, options_.force_gate));
  talk_.store(talks_.back().get());
  PALPATE_TRY(link_->open(*talks_.back()));
  state_ = {};
  open_ = true;
  Status ready = wait_for_device();
  if (!ready) {
    close();
    return ready;
  }
  set_scaling();
  return Done{};
}

Status Inverse3Device::wait_for_device() {
  const Inverse3Session& talk = *talk_.load();
  for (int i = 0; i < options_.open_tries; ++i) {
    if (talk.present() && talk.zero_sent()) return Done{};
    if (talk.gone()) return Error{"the service hung up", "look at its log, start it again", name()};
    options_.wait();
  }
  if (talk.texts() == 0)
    return Error{"the service says nothing", "start it again: systemctl restart haply-inverse-service",
                 name()};
  if (talk.malformed_in_a_row() > 0)
    return Error{"what the service says is not understood", "install version 3.1 or later of it", name()};
  return Error{options_.device_id.empty() ? "the service is there, and no Inverse3"
                                          : "the service lists no Inverse3 '" + options_.device_id + "'",
               "connect it and switch it on; its light says when it is ready", name()};
}

/// The service takes this setting only over HTTP. Its answer is reported; nobody has observed its effect.
void Inverse3Device::set_scaling() {
  const Inverse3Session& talk = *talk_.load();
  facts_ = {{"device_id", talk.device_id()},
            {"service", options_.service.host + ":" + std::to_string(options_.service.port)},
            {"force_gate_set", format_number(options_.force_gate)},
            {"torque_scaling_set", options_.torque_scaling ? "on" : "off"},
            {"config_at_start", talk.config()}};
  HttpRequest request{options_.service.host, options_.service.port, "POST",
                      "/inverse3/" + talk.device_id() + "/config/torque_scaling",
                      inverse3_scaling_body(options_.torque_scaling)};
  const auto record_answer = [&](const char* what) {
    const Result<HttpAnswer> answer = options_.http(request);
    facts_.emplace_back(what, answer ? std::to_string(answer->status) + " " + answer->body
                                     : "not answered: " + answer.error().what);
  };
  record_answer("torque_scaling_answer");
  request.method = "GET";
  request.body.clear();
  record_answer("torque_scaling_now");
  request.path = "/inverse3/" + talk.device_id() + "/config/force_gate?session=:0";
  record_answer("force_gate_now");
}

void Inverse3Device::close() noexcept {
  if (!open_) return;
  open_ = false;
  talk_.load()->zero();
  link_->close();
}

DeviceState Inverse3Device::read() noexcept {
  state_.status = open_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  if (!open_) return state_;
  Inverse3Session& talk = *talk_.load(std::memory_order_relaxed);
  Inverse3Session::Seen seen;
  if (talk.newest(seen)) {
    state_.position_mm = seen.position_mm - options_.centre_mm;
    state_.buttons = seen.buttons;
    state_.packet_ns = seen.packet_ns;
    state_.status = ReadStatus::kFresh;
  } else if (talk.malformed_in_a_row() >= kMostNonsense) {
    state_.status = ReadStatus::kGarbled;
  }
  if (!talk.present()) state_.status = ReadStatus::kLost;
  return state_;
}

void Inverse3Device::send(GovernedForce force) noexcept {
  if (open_) talk_.load(std::memory_order_relaxed)->force(force.newtons());
}

bool Inverse3Device::cut_force() noexcept {
  Inverse3Session* const talk = talk_.load();
  if (talk == nullptr) return false;
  talk->zero();
  return !talk->gone();
}

// Finds and makes the Inverse3 over real links; apart from its session and texts, which are fuzzed without
// any.

namespace {

Status read_centre(const std::string& value, Vec3& centre_mm) {
  constexpr NumberRange kRange{-1000.0, 1000.0};
  std::size_t at = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t end = axis < 2 ? value.find('/', at) : value.size();
    if (end == std::string::npos) return Error{"centre-mm is '" + value + "'", "write X/Y/Z, mm"};
    const Result<double> number = read_number(value.substr(at, end - at), kRange);
    if (!number) return Error{"centre-mm: " + number.error().what, "write X/Y/Z, mm"};
    centre_mm[axis] = *number;
    at = end + 1;
  }
  return Done{};
}

Status take_inverse3_options(Inverse3Options& options, const DeviceRequest& request) {
  const auto take_service = [&options](const std::string& value) -> Status {
    PALPATE_ASSIGN(const UdpAddress address, UdpAddress::of(value));
    options.service.host = address.host;
    options.service.port = address.port;
    return Done{};
  };
  const auto take_centre = [&options](const std::string& value) {
    return read_centre(value, options.centre_mm);
  };
  return take_options(request, "inverse3",
                      {{"service", take_service},
                       number_option("force-gate", options.force_gate, {0.0, 1.0}),
                       switch_option("torque-scaling", options.torque_scaling),
                       {"centre-mm", take_centre},
                       number_option("force-max-n", options.limits.force_max_n, {0.0, 10.0, true})});
}

bool release_inverse3(const Inverse3Options& options) {
  constexpr int kTries = 300;
  const MonotonicClock clock;
  Inverse3Session talk(clock, options.device_id, options.force_gate);
  WebSocketLink link(options.service);
  if (!link.open(talk)) return false;
  for (int i = 0; i < kTries && !talk.zero_sent() && !talk.gone(); ++i) sleep_ms();
  link.close();
  return talk.zero_sent();
}

Result<MadeDevice> make_inverse3(const DeviceRequest& request, const Clock& clock) {
  Inverse3Options options;
  options.name = request.name;
  if (const std::size_t colon = request.name.find(':'); colon != std::string::npos)
    options.device_id = request.name.substr(colon + 1);
  if (!request.description.empty())
    return Error{"the Inverse3 has no description file", "leave it out", request.description.string()};
  PALPATE_TRY(take_inverse3_options(options, request));
  MadeDevice made;
  auto device =
      std::make_unique<Inverse3Device>(std::make_unique<WebSocketLink>(options.service), clock, options);
  made.facts = [device = device.get()] { return device->facts(); };
  made.device = std::move(device);
  made.zero = [options] { return release_inverse3(options); };
  made.unproven = {
      "the Inverse3 was never connected: positions, forces, axes, limits and the service's filters "
      "are as its maker's pages tell"};
  return made;
}

std::vector<DeviceEntry> look_for_inverse3() {
  HttpRequest request;
  request.port = kInverse3Port;
  DeviceEntry entry{
      "inverse3", "Haply Inverse3, through its maker's local service", DeviceStatus::kReady, {}};
  // Any service that answers counts; opening shows what is connected.
  if (!http_request(request)) {
    entry.status = DeviceStatus::kMissing;
    entry.needs = {"the maker's service on port " + std::to_string(kInverse3Port) +
                   ": install the package haply-inverse-service from its maker, then `systemctl start "
                   "haply-inverse-service`"};
  }
  return {entry};
}

}  // namespace

void register_inverse3_driver(Drivers& drivers) {
  drivers.add({"inverse3", "network", look_for_inverse3, make_inverse3});
}

}  // namespace palpate::device
