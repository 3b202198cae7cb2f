#include "common/base/parallel.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <list>
#include <mutex>
#include <set>
#include <system_error>
#include <thread>
#include <typeinfo>

#include "common/base/loops/loop_recorder.h"
#include "common/base/machine_limits.h"

namespace tessera {
namespace {

constexpr int kMostAtOnce = 64;

// Pauses of a thread before it sleeps, at most about 50 us together: loops often follow each other at once. oneTBB's
// threads look for work several times longer and call sched_yield meanwhile, which took 3 % of the processor time of an
// untiled job and 6 % of one in tiles.
constexpr int kPauses = 1000;

void Pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#else
  std::this_thread::yield();
#endif
}

// The limits of all ThreadLimits.
class Limits {
 public:
  std::multiset<int>::iterator Add(int threads) {
    const std::lock_guard lock(mutex_);
    const auto added = limits_.insert(threads);
    least_ = *limits_.begin();
    return added;
  }
  void Remove(std::multiset<int>::iterator limit) {
    const std::lock_guard lock(mutex_);
    limits_.erase(limit);
    least_ = limits_.empty() ? cores_ : *limits_.begin();
  }
  int least() const { return least_; }

 private:
  const int cores_ = CoreLimit();
  std::atomic<int> least_ = cores_;
  std::mutex mutex_;
  std::multiset<int> limits_;
};

Limits& TheLimits() {
  static Limits* const limits = new Limits;
  return *limits;
}

// A loop over chunks that several threads work on. Each has a part of its own and then helps with the others', so that
// a thread gets the same chunks in loops that follow each other, and finds their data in its cache.
class Loop {
 public:
  Loop(int64_t chunks, const std::function<void(int64_t)>& run, int threads)
      : run_(run), parts_(static_cast<size_t>(std::min<int64_t>(threads, chunks))) {
    const auto count = static_cast<int64_t>(parts_.size());
    for (int64_t i = 0; i < count; ++i) {
      parts_[i].next = i * chunks / count;
      parts_[i].end = (i + 1) * chunks / count;
    }
  }

  bool has_work() const {
    return std::any_of(parts_.begin(), parts_.end(), [](const Part& part) { return part.next < part.end; });
  }
  // Thread-safe. `thread`: its number; the first is 0.
  void Work(size_t thread) {
    try {
      for (size_t i = 0; i < parts_.size(); ++i) {
        Part& part = parts_[(thread + i) % parts_.size()];
        for (int64_t chunk; (chunk = part.next++) < part.end;) run_(chunk);
      }
    } catch (...) {
      for (Part& part : parts_) part.next = part.end;
      const std::lock_guard lock(error_mutex_);
      if (!error_) error_ = std::current_exception();
    }
  }
  // After the last thread has left.
  void ThrowError() const {
    if (error_) std::rethrow_exception(error_);
  }

  std::atomic<int> helpers = 0;  // threads in it beside its own; grows under Pool::mutex_ while the loop is listed

 private:
  struct alignas(64) Part {
    std::atomic<int64_t> next = 0;
    int64_t end = 0;
  };
  const std::function<void(int64_t)>& run_;
  std::vector<Part> parts_;
  std::mutex error_mutex_;
  std::exception_ptr error_;  // the first
};

// Threads that help with loops. They are created when a loop first needs them, and kept. A thread that has no more
// chunks of its loop waits for its helpers and takes no chunks of other loops meanwhile: it may hold what these need.
// Loops may be nested; one that finds no idle thread runs on its own.
class Pool {
 public:
  void Run(int64_t chunks, const std::function<void(int64_t)>& run) {
    const int helpers = ThreadCount() - 1;
    if (chunks <= 1 || helpers <= 0 || (idle_ == 0 && threads_ >= helpers)) {
      for (int64_t chunk = 0; chunk < chunks; ++chunk) run(chunk);
      return;
    }
    Loop loop(chunks, run, helpers + 1);
    Open(&loop, chunks, helpers);
    loop.Work(0);
    Close(&loop);
    loop.ThrowError();
  }

 private:
  void Open(Loop* loop, int64_t chunks, int helpers) {
    int64_t wanted = 0;
    bool all = false;
    {
      const std::lock_guard lock(mutex_);
      loops_.push_back(loop);
      ++opened_;
      AddThreads(helpers);
      wanted = std::min<int64_t>({chunks - 1, helpers, sleeping_});
      all = wanted == sleeping_;
    }
    if (all) {
      changed_.notify_all();
    } else {
      for (int64_t i = 0; i < wanted; ++i) changed_.notify_one();
    }
  }

  void Close(Loop* loop) {
    std::unique_lock lock(mutex_);
    loops_.remove(loop);
    lock.unlock();
    for (int i = 0; i < kPauses && loop->helpers > 0; ++i) Pause();
    lock.lock();
    ended_.wait(lock, [&] { return loop->helpers == 0; });
  }

  // Fewer if the system allows no more: the loop then runs on those that there are.
  void AddThreads(int wanted) {
    try {
      for (; threads_ < wanted; ++threads_) std::thread([this, number = threads_ + 1] { Serve(number); }).detach();
    } catch (const std::system_error&) {
    }
  }

  Loop* FindWork() const {
    const auto found = std::find_if(loops_.begin(), loops_.end(), [](const Loop* loop) { return loop->has_work(); });
    return found == loops_.end() ? nullptr : *found;
  }

  // Works on the loop without the lock.
  void Help(Loop* loop, size_t thread, std::unique_lock<std::mutex>& lock) {
    ++loop->helpers;
    lock.unlock();
    loop->Work(thread);
    lock.lock();
    if (--loop->helpers == 0) ended_.notify_all();
  }

  void Serve(size_t thread) {
    std::unique_lock lock(mutex_);
    ++idle_;
    while (true) {
      if (Loop* const loop = busy_ < ThreadCount() - 1 ? FindWork() : nullptr) {
        ++busy_;
        --idle_;
        Help(loop, thread, lock);
        --busy_;
        ++idle_;
        continue;
      }
      const int64_t seen = opened_;
      lock.unlock();
      for (int i = 0; i < kPauses && opened_ == seen; ++i) Pause();
      lock.lock();
      if (opened_ != seen) continue;
      ++sleeping_;
      changed_.wait(lock);
      --sleeping_;
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_, ended_;
  std::list<Loop*> loops_;           // of which chunks may not have begun
  std::atomic<int64_t> opened_ = 0;  // number of loops so far
  std::atomic<int> threads_ = 0;     // of the pool
  std::atomic<int> idle_ = 0;        // threads of the pool that are in no loop
  int64_t sleeping_ = 0;             // of these, those that do not look for loops
  int busy_ = 0;                     // threads of the pool in loops
};

// `body`: the type of the loop's body.
void ForEachChunk(int64_t chunks, const std::function<void(int64_t)>& run, const std::type_info& body) {
  static Pool* const pool = new Pool;
  if (LoopRecorder* const recorder = LoopRecorder::OfThisThread()) return recorder->Run(chunks, run, body);
  pool->Run(chunks, run);
}

}  // namespace

void ParallelFor(int64_t count, int64_t grain, const std::function<void(int64_t, int64_t)>& body) {
  const int64_t step = std::max<int64_t>(grain, 1);
  ForEachChunk(
      (std::max<int64_t>(count, 0) + step - 1) / step,
      [&](int64_t chunk) { body(chunk * step, std::min(count, (chunk + 1) * step)); }, body.target_type());
}

double ParallelSum(int64_t count, int64_t grain, const std::function<double(int64_t, int64_t)>& body) {
  const int64_t step = std::max<int64_t>(grain, 1);
  std::vector<double> partial((std::max<int64_t>(count, 0) + step - 1) / step);
  ForEachChunk(
      static_cast<int64_t>(partial.size()),
      [&](int64_t chunk) { partial[chunk] = body(chunk * step, std::min(count, (chunk + 1) * step)); },
      body.target_type());
  double sum = 0;
  for (double part : partial) sum += part;
  return sum;
}

void ConcurrentForEach(int64_t count, int at_once, const std::function<void(int64_t)>& body) {
  std::atomic<int64_t> next = 0;
  const auto work = [&] {
    for (int64_t i; (i = next++) < count;) body(i);
  };
  std::vector<std::jthread> others;
  for (int64_t thread = 1; thread < std::min<int64_t>(at_once, count); ++thread) others.emplace_back(work);
  work();
}

int ItemsAtOnce(double bytes_each) {
  const int most = std::min(ThreadCount(), kMostAtOnce);
  const auto room = static_cast<double>(LookaheadLimit_bytes(most));
  return bytes_each * most <= room ? most : std::max(1, static_cast<int>(room / bytes_each));
}

int ThreadCount() { return TheLimits().least(); }

struct ThreadLimit::Impl {
  std::multiset<int>::iterator limit;
};

ThreadLimit::ThreadLimit(int threads) : impl_(new Impl{TheLimits().Add(threads > 0 ? threads : CoreLimit())}) {}

ThreadLimit::~ThreadLimit() { TheLimits().Remove(impl_->limit); }

}  // namespace tessera
