// Files that are whole or absent, and what is done when a program is stopped.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/triple_buffer.h>
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hardware.h"

namespace palpate {
namespace {

class Files : public InFolder {
 protected:
  std::string text(const std::string& name) const {
    std::ostringstream all;
    all << std::ifstream(in(name)).rdbuf();
    return all.str();
  }
  bool there(const std::string& name) const { return std::filesystem::exists(in(name)); }
};

TEST_F(Files, AppearWholeOrNotAtAll) {
  {
    Result<AtomicFile> file = AtomicFile::create(in("a"));
    ASSERT_TRUE(file.ok() && file->write("half").ok());
    EXPECT_FALSE(there("a"));
  }
  EXPECT_FALSE(there("a.part"));
  // What a writer that was killed has left is no part of the next one's file.
  std::ofstream(in("a.part")) << "left behind by a writer that was killed";
  ASSERT_TRUE(write_file(in("a"), "whole").ok());
  EXPECT_EQ(text("a"), "whole");
  EXPECT_FALSE(there("a.part"));
}

TEST_F(Files, ASecondWriterIsRefused) {
  Result<AtomicFile> first = AtomicFile::create(in("a"));
  ASSERT_TRUE(first.ok() && first->write("first").ok());
  EXPECT_TRUE(test::refused(write_file(in("a"), "second"), "another program is writing"));
  ASSERT_TRUE(first->commit().ok());
  EXPECT_EQ(text("a"), "first");
  EXPECT_TRUE(write_file(in("a"), "second").ok());
}

TEST_F(Files, ALockIsOfTheFileThatHasTheName) {
  const Result<LockedFile> first = LockedFile::open(in("lock"));
  ASSERT_TRUE(first.ok() && first->held());
  auto second = test::value_of(LockedFile::open(in("lock")));
  EXPECT_FALSE(second.held());
  std::filesystem::remove(in("lock"));
  {
    const Result<LockedFile> third = LockedFile::open(in("lock"));
    ASSERT_TRUE(third.ok() && third->held()) << "that of a file that is gone keeps nobody out";
  }
  EXPECT_TRUE(LockedFile::open(in("lock"))->held()) << "given back";
  EXPECT_FALSE(LockedFile::open(in("nowhere/lock")).ok());
}

/// What a stop does, in a process of its own: it ends there.
TEST_F(Files, AStopRunsWhatLivesTheNewestFirst) {
  const auto stop = [&] {
    const StopCallback oldest([] { return std::string("three"); });
    StopCallback moved;
    {
      StopCallback dropped([] { return std::string("dropped"); });
      StopCallback inner([] { return std::string("two"); });
      moved = std::move(inner);
    }
    const StopCallback silent([] { return std::string(); });
    Result<AtomicFile> half = AtomicFile::create(in("half"));
    Result<AtomicFile> done = AtomicFile::create(in("done"));
    const StopCallback newest([] { return std::string("one"); });
    const bool written = half->write("half").ok() && done->commit().ok();
    const std::string said = run_stop_callbacks();
    ::_exit(written && said == "one; two; three" ? 0 : 1);
  };
  EXPECT_EXIT(stop(), testing::ExitedWithCode(0), "");
  EXPECT_FALSE(there("half.part"));
  EXPECT_TRUE(there("done"));
}

// Files as they are opened: regular ones alone, and never a wait for the others.

class InputFiles : public InFolder {
 protected:
  [[nodiscard]] std::string holding(const std::string& name, const std::string& text) const {
    std::ofstream(in(name), std::ios::binary) << text;
    return in(name);
  }
  static std::string refusal(const std::string& path) {
    const Result<InputFile> file = InputFile::open(path);
    EXPECT_FALSE(file.ok()) << path;
    if (file) return {};
    EXPECT_EQ(file.error().file, path);
    EXPECT_EQ(file.error().line, 0);
    EXPECT_FALSE(file.error().remedy.empty());
    return file.error().what;
  }
};

TEST_F(InputFiles, ARegularFileIsReadWhole) {
  const std::string path = holding("a.txt", "one two");
  auto file = test::value_of(InputFile::open(path));
  EXPECT_EQ(file.size(), 7u);
  std::string text(5, ' ');
  EXPECT_EQ(*file.read(std::as_writable_bytes(std::span(text))), 5u);
  EXPECT_EQ(text, "one t");
  InputFile moved = std::move(file);
  EXPECT_EQ(*moved.read(std::as_writable_bytes(std::span(text))), 2u);
  EXPECT_EQ(text.substr(0, 2), "wo");
  EXPECT_EQ(*moved.read(std::as_writable_bytes(std::span(text))), 0u);
  EXPECT_EQ(*read_file(path, 7), "one two");
  EXPECT_FALSE(read_file(path, 6).ok());
  EXPECT_EQ(*read_file(holding("empty", ""), 0), "");
}

TEST_F(InputFiles, WhatIsNoRegularFileIsNamed) {
  EXPECT_TRUE(test::contains(refusal(folder_.string()), "folder"));
  EXPECT_EQ(refusal(in("none")), "no such file");
  std::filesystem::create_symlink(in("none"), in("dangling"));
  EXPECT_EQ(refusal(in("dangling")), "no such file");
  EXPECT_EQ(refusal(holding("file", "x") + "/below"), "no such file");
  // A pipe without a writer: opened as a file is, it would wait for ever.
  ASSERT_EQ(::mkfifo(in("pipe").c_str(), 0600), 0);
  EXPECT_TRUE(test::contains(refusal(in("pipe")), "a pipe"));
  for (const char* device : {"/dev/zero", "/dev/null"}) {
    std::filesystem::remove(in("device"));
    std::filesystem::create_symlink(device, in("device"));
    EXPECT_TRUE(test::contains(refusal(in("device")), "a device"));
  }
  const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::filesystem::current_path(folder_);  // the path of a socket has little room
  address.sun_path[0] = 's';
  ASSERT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_TRUE(test::contains(refusal(in("s")), "a socket"));
  ::close(fd);
  std::filesystem::current_path("/");
}

TEST_F(InputFiles, SizesThatAreNotTrue) {
  // A hole of a terabyte takes nothing on the disk, and is refused before it takes memory.
  const std::string hole = holding("hole", "");
  if (::truncate(hole.c_str(), off_t{1} << 40) == 0) {
    EXPECT_FALSE(read_file(hole, 1u << 20).ok());
  }
  // Files of the system say 0 and hold more.
  const auto status = test::value_of(read_file("/proc/self/status", 1u << 20));
  EXPECT_NE(status.find("Name:"), std::string::npos);
  EXPECT_FALSE(read_file("/proc/self/status", 10).ok());
}

TEST(ByteOrderMark, OfUtf8IsPassedOverAndOthersAreNamed) {
  EXPECT_EQ(*byte_order_mark(""), 0u);
  EXPECT_EQ(*byte_order_mark("t_s"), 0u);
  EXPECT_EQ(*byte_order_mark("\xEF\xBB\xBFt_s"), 3u);
  const std::string nul(2, '\0');
  for (const std::string& mark : {std::string("\xFF\xFEt"), std::string("\xFE\xFF")})
    EXPECT_EQ(byte_order_mark(mark).error().what, "the text is UTF-16");
  for (const std::string& mark : {"\xFF\xFE" + nul, nul + "\xFE\xFF"})
    EXPECT_EQ(byte_order_mark(mark).error().what, "the text is UTF-32");
  EXPECT_EQ(byte_order_mark("\xFF\xFEt").error().line, 1);
}

struct alignas(64) Line {
  std::uint8_t bytes[64];
};

template <class T>
void expect_aligned(std::size_t count) {
  // Several at a time: one alone may lie well by chance.
  std::vector<LargePageVector<T>> arrays(16);
  for (LargePageVector<T>& array : arrays) {
    array.resize(count);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(array.data()) % alignof(T), 0u) << count;
  }
}

TEST(LargePages, ElementsAreAlignedHoweverFew) {
  constexpr std::size_t kCounts[] = {1, 2, 3, 7, 100, 70'000};
  for (const std::size_t count : kCounts) {
    expect_aligned<Line>(count);
    expect_aligned<double>(count);
    expect_aligned<std::uint8_t>(count);
  }
}

template <class Vector>
void expect_as_a_vector() {
  Vector numbers(3, 7);
  numbers.push_back(8);
  EXPECT_EQ(numbers, (Vector{7, 7, 7, 8}));
  numbers.resize(2);
  numbers.resize(5, 9);
  EXPECT_EQ(numbers, (Vector{7, 7, 9, 9, 9}));
  numbers.resize(6);  // the sixth is anything
  numbers.back() = 1;
  Vector moved = std::move(numbers);
  const Vector copied = moved;
  EXPECT_EQ(copied, (Vector{7, 7, 9, 9, 9, 1}));
  moved.assign(1'000'000, 4);
  EXPECT_EQ(moved.back(), 4u);
}

TEST(UnsetVectors, AreVectors) {
  expect_as_a_vector<UninitializedVector<std::uint32_t>>();
  expect_as_a_vector<LargePageUninitializedVector<std::uint32_t>>();
}

// Values handed over between two threads.

/// Torn where not all numbers are the same.
using Block = std::array<std::uint64_t, 64>;

Block block(std::uint64_t value) {
  Block b;
  b.fill(value);
  return b;
}

bool whole(const Block& b) {
  return std::all_of(b.begin(), b.end(), [&](std::uint64_t v) { return v == b.front(); });
}

/// Every order of twelve publications and fetches, against the obvious model.
TEST(TripleBuffer, EveryOrderOfCallsGivesTheNewestValue) {
  constexpr unsigned kCalls = 12;
  for (unsigned order = 0; order < (1u << kCalls); ++order) {
    TripleBuffer<int> box(7);
    int published = 7, seen = 7;
    for (unsigned call = 0; call < kCalls; ++call) {
      if ((order >> call & 1u) != 0) {
        box.publish(++published);
      } else {
        EXPECT_EQ(box.acquire(), published != seen);
        seen = published;
      }
      ASSERT_EQ(box.front(), seen) << "order " << order << ", call " << call;
    }
  }
}

TEST(TripleBuffer, PreallocatedMemoryIsUsedAgain) {
  TripleBuffer<std::vector<double>> box(std::vector<double>(1000));
  std::array<const double*, 3> seen{};
  for (std::size_t i = 0; i < 30; ++i) {
    box.back().assign(1000, static_cast<double>(i));
    const double* const memory = box.back().data();
    if (i < 3)
      seen[i] = memory;
    else
      EXPECT_NE(std::find(seen.begin(), seen.end(), memory), seen.end()) << "allocated anew";
    box.publish();
    if (i < 3 || i % 2 == 0) box.acquire();
  }
  EXPECT_EQ(box.front().size(), 1000u);
}

/// What ThreadSanitizer watches: a reader and a writer at full speed.
TEST(TripleBuffer, TwoThreadsNeverTearAndNeverGoBack) {
  constexpr std::uint64_t kValues = 50'000;
  TripleBuffer<Block> box(block(0));
  std::uint64_t torn = 0, older = 0, not_newer = 0, taken = 0, last = 0;
  std::thread reader([&] {
    while (last < kValues) {
      const bool fresh = box.acquire();
      const Block& b = box.front();
      torn += whole(b) ? 0u : 1u;
      older += b.front() < last ? 1u : 0u;
      not_newer += fresh && b.front() <= last ? 1u : 0u;
      taken += fresh ? 1u : 0u;
      last = b.front();
      if (!fresh) std::this_thread::yield();
    }
  });
  for (std::uint64_t i = 1; i <= kValues; ++i) {
    box.back().fill(i);
    box.publish();
    if (i % 64 == 0) std::this_thread::yield();
  }
  reader.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(older, 0u);
  EXPECT_EQ(not_newer, 0u);
  EXPECT_EQ(last, kValues) << "the last value was lost";
  EXPECT_GE(taken, 1u);
}

TEST(PageFaults, AreCountedOncePerPageAndByThread) {
  constexpr std::size_t kPages = 64;
  const auto page_bytes = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  void* const memory =
      ::mmap(nullptr, kPages * page_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  ::madvise(memory, kPages * page_bytes, MADV_NOHUGEPAGE);  // where there are some, one serves many
  auto* const bytes = static_cast<volatile unsigned char*>(memory);
  const auto touch = [&] {
    const PageFaults before = thread_page_faults();
    for (std::size_t page = 0; page < kPages; ++page) bytes[page * page_bytes] = 1;
    return thread_page_faults() - before;
  };
  const PageFaults mine = thread_page_faults();
  PageFaults first, again;
  std::thread([&] { first = touch(), again = touch(); }).join();
  EXPECT_GE(first.minor, kPages);
  EXPECT_EQ(first.major, 0u);
  EXPECT_EQ(again.minor, 0u);
  EXPECT_LT((thread_page_faults() - mine).minor, kPages) << "of another thread";
  ::munmap(memory, kPages * page_bytes);
}

}  // namespace
}  // namespace palpate
