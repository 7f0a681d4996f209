// A HID device that is not there: what hidapi, libudev and the kernel's hidraw would show of it, by umockdev.
// The program must run under umockdev-wrapper.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace palpate::device {

struct HidrawIdentity {
  std::uint16_t vendor = 0x1234, product = 0x0006;
  std::uint16_t usage_page = 0xFFAB, usage = 0x0200;
  std::string serial = "one", product_name = "Pretended arm";
  bool numbered = false;  ///< its reports have numbers
};

/// A report descriptor: one collection of the identity's usage, so many bytes in and out.
[[nodiscard]] inline std::vector<std::uint8_t> hid_descriptor(const HidrawIdentity& identity,
                                                              std::uint8_t bytes) {
  const auto low = [](std::uint16_t value) { return static_cast<std::uint8_t>(value & 0xFFU); };
  const auto high = [](std::uint16_t value) { return static_cast<std::uint8_t>(value >> 8U); };
  std::vector<std::uint8_t> all = {0x06,
                                   low(identity.usage_page),
                                   high(identity.usage_page),
                                   0x0A,
                                   low(identity.usage),
                                   high(identity.usage),
                                   0xA1,
                                   0x01};
  if (identity.numbered) all.insert(all.end(), {0x85, 0x01});
  all.insert(all.end(), {0x75, 0x08, 0x15, 0x00, 0x26,  0xFF, 0x00, 0x95, bytes, 0x09,
                         0x01, 0x81, 0x02, 0x95, bytes, 0x09, 0x02, 0x91, 0x02,  0xC0});
  return all;
}

/// The functions may be called by any thread; the board's answers are made in umockdev's.
class HidrawDouble {
 public:
  using Bytes = std::vector<std::uint8_t>;
  /// What the device reports in answer to what was written (with the 0 that stands for no number).
  using Answer = std::function<std::optional<Bytes>(std::span<const std::uint8_t>)>;

  /// Plugged in. One testbed for all doubles of a program.
  explicit HidrawDouble(HidrawIdentity identity, Answer answer = {});
  ~HidrawDouble();
  HidrawDouble(const HidrawDouble&) = delete;
  HidrawDouble& operator=(const HidrawDouble&) = delete;

  /// A report that nobody asked for.
  void report(const Bytes& bytes);
  void unplug();
  void plug();
  /// Answers no more, and takes what is written.
  void silence(bool silent);
  [[nodiscard]] std::vector<Bytes> written() const;
  /// "/dev/hidrawN"; another N each time it is plugged in.
  [[nodiscard]] std::string node() const;

  /// Whether umockdev's library stands before the system's.
  [[nodiscard]] static bool possible();

 private:
  struct Bed;
  std::unique_ptr<Bed> bed_;
};

// A HID device of the running kernel, through its module uhid: hidraw, sysfs and the queue of reports are the
// kernel's own.

class UhidDouble {
 public:
  using Bytes = HidrawDouble::Bytes;
  using Answer = HidrawDouble::Answer;

  /// Why it cannot be made here; empty: it can.
  [[nodiscard]] static std::string missing();

  /// Plugged in, and found.
  explicit UhidDouble(const HidrawIdentity& identity, Answer answer = {});
  ~UhidDouble();
  UhidDouble(const UhidDouble&) = delete;
  UhidDouble& operator=(const UhidDouble&) = delete;

  /// A report that nobody asked for.
  void report(const Bytes& bytes);
  /// Returns when the kernel has seen it.
  void unplug();
  void plug();

 private:
  struct Node;
  std::unique_ptr<Node> node_;
};

}  // namespace palpate::device
