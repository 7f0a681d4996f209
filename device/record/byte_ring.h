// Internal to recordings: records of bytes from one thread to another without a lock. One thread pushes, one
// pops; neither ever waits for the other.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

namespace palpate::device {

class ByteRing {
 public:
  /// Allocates, and touches every byte, so that no page is missing later.
  explicit ByteRing(std::size_t bytes) : bytes_(bytes) {}

  /// Of the thread that pushes: the record is whole in the ring, or nothing of it (there is no room).
  [[nodiscard]] bool push(std::span<const std::byte> record) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);  // ours alone
    // Acquire: what was there was read before it is written over.
    const std::uint64_t tail = tail_.load(std::memory_order_acquire);
    const auto size = static_cast<std::uint32_t>(record.size());
    if (head - tail + sizeof(size) + record.size() > bytes_.size()) return false;
    put(head, std::as_bytes(std::span(&size, 1)));
    put(head + sizeof(size), record);
    // Release: who sees the new head sees the record.
    head_.store(head + sizeof(size) + record.size(), std::memory_order_release);
    return true;
  }

  /// Of the thread that pops: the oldest record, put into `into`, which has room for the longest one. Its
  /// size; 0: there is none.
  [[nodiscard]] std::size_t pop(std::span<std::byte> into) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);  // ours alone
    if (head_.load(std::memory_order_acquire) == tail) return 0;
    std::uint32_t size = 0;
    get(tail, std::as_writable_bytes(std::span(&size, 1)));
    get(tail + sizeof(size), into.first(size));
    tail_.store(tail + sizeof(size) + size, std::memory_order_release);
    return size;
  }

  /// Any thread: bytes that wait.
  [[nodiscard]] std::size_t used() const noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_acquire);
    return static_cast<std::size_t>(head_.load(std::memory_order_acquire) - tail);
  }
  [[nodiscard]] std::size_t capacity() const noexcept { return bytes_.size(); }

 private:
  void put(std::uint64_t at, std::span<const std::byte> from) noexcept {
    const auto place = static_cast<std::size_t>(at % bytes_.size());
    const std::size_t first = std::min(from.size(), bytes_.size() - place);
    std::memcpy(bytes_.data() + place, from.data(), first);
    std::memcpy(bytes_.data(), from.data() + first, from.size() - first);
  }
  void get(std::uint64_t at, std::span<std::byte> into) const noexcept {
    const auto place = static_cast<std::size_t>(at % bytes_.size());
    const std::size_t first = std::min(into.size(), bytes_.size() - place);
    std::memcpy(into.data(), bytes_.data() + place, first);
    std::memcpy(into.data() + first, bytes_.data(), into.size() - first);
  }

  // Two lines of 64 bytes: processors fetch them in pairs, and the two threads must not share one.
  static constexpr std::size_t kApart = 128;
  std::vector<std::byte> bytes_;
  alignas(kApart) std::atomic<std::uint64_t> head_{0};  ///< bytes pushed so far
  alignas(kApart) std::atomic<std::uint64_t> tail_{0};  ///< bytes popped so far
};

}  // namespace palpate::device
