// Members that hardly any value of a type has: lists of what went wrong, say.
#ifndef TESSERA_COMMON_BASE_RARELY_H_
#define TESSERA_COMMON_BASE_RARELY_H_

#include <memory>
#include <utility>

namespace tessera {

// A T, in the memory of a pointer while it is T() and was not edited. As thread-safe as a T.
template <class T>
class Rarely {
 public:
  Rarely() = default;
  Rarely(T value)  // NOLINT(google-explicit-constructor)
      : value_(value == T() ? nullptr : std::make_unique<T>(std::move(value))) {}
  Rarely(const Rarely& other) : value_(other.value_ ? std::make_unique<T>(*other.value_) : nullptr) {}
  Rarely(Rarely&&) noexcept = default;
  Rarely& operator=(const Rarely& other) { return *this = Rarely(other); }
  Rarely& operator=(Rarely&&) noexcept = default;
  void Clear() { value_.reset(); }

  const T& operator*() const&& = delete;  // it would go with this
  const T& operator*() const& {
    static const T kNone;
    return value_ ? *value_ : kNone;
  }
  const T* operator->() const { return &**this; }
  operator const T&() const& { return **this; }  // NOLINT(google-explicit-constructor)
  T& Edit() {
    if (!value_) value_ = std::make_unique<T>();
    return *value_;
  }

 private:
  std::unique_ptr<T> value_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_RARELY_H_
