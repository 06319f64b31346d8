// Aligned memory that is kept from call to call.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <new>

namespace mattgs {

// Uninitialised memory that is kept for the next call; contents are lost when it grows.
template <class T>
class Buffer {
public:
    Buffer() = default;
    Buffer(Buffer&& other) noexcept : data_(other.data_), capacity_(other.capacity_) {
        other.data_ = nullptr;
        other.capacity_ = 0;
    }
    Buffer& operator=(Buffer&&) = delete;
    ~Buffer() { std::free(data_); }

    T* fit(int64_t count) {
        if (count > capacity_) {
            std::free(data_);
            capacity_ = 0;
            data_ = allocate(count + count / 4);
            capacity_ = count + count / 4;
        }
        return data_;
    }

    T* extend(int64_t count, int64_t used) {  // keeps the first `used`
        if (count <= capacity_) return data_;
        T* grown = allocate(count);
        for (int64_t i = 0; i < used; ++i) grown[i] = data_[i];
        std::free(data_);
        data_ = grown;
        capacity_ = count;
        return data_;
    }

    T* data() const { return data_; }
    int64_t capacity() const { return capacity_; }
    int64_t bytes() const { return capacity_ * static_cast<int64_t>(sizeof(T)); }

private:
    static T* allocate(int64_t count) {
        const std::size_t size = (static_cast<std::size_t>(count) * sizeof(T) + 127) / 64 * 64;
        void* p = std::aligned_alloc(64, size);
        if (!p) throw std::bad_alloc();
        return static_cast<T*>(p);
    }

    T* data_ = nullptr;
    int64_t capacity_ = 0;
};

}  // namespace mattgs
