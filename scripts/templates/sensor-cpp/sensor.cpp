// A sensor in C++17 without packages: rename the struct, define your fields with units in their names, and read your
// device in read_device. It declares its own message through the gateway of a robot and publishes samples of it.
//
//     g++ -std=c++17 -O2 -o soil sensor.cpp
//     nims plug gateway -- gateway --socket /tmp/robot.sock
//     nims plug soil -- ./soil /tmp/robot.sock soil
//
// As a [[plugin]] it needs no arguments: the service sets NIMS_GATEWAY and NIMS_NAME.

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <thread>

// The sample as it is in memory, little-endian, without padding: its size is a multiple of 8.
struct Example {
    uint64_t header[6];  // the gateway fills it in
    double value_v;
    double samples[4];
};
static_assert(sizeof(Example) == 88, "no hidden padding");

// The same as a ROS 2 definition; comments say what fields are, and are in the run file.
const char *const MESSAGE = "Example";
const std::string DEFINITION = R"(# A reading of the device.
nims_msgs/Header header
# Voltage of the probe, V.
float64 value_v
# The last four counts.
float64[4] samples
)";
const double RATE_HZ = 10.0;

// Reads your device.
void read_device(uint64_t count, Example &sample) {
    sample.value_v = 0.1 * double(count);
    for (int k = 0; k < 4; k++) sample.samples[k] = double(count + k);
}

// The definition of the header, which every message of nims begins with.
const std::string HEADER = std::string(80, '=') + R"(
MSG: nims_msgs/Header
uint64 life
uint64 cycle
uint64 seq
uint64 stamp_ns
uint64 published_ns
uint64 oldest_input_ns
)";

// The connection to the gateway: frames of two lengths, a header in JSON and a body of bytes.
class Gateway {
public:
    explicit Gateway(const std::string &path) : link(socket(AF_UNIX, SOCK_STREAM, 0)) {
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        if (path.size() >= sizeof(address.sun_path)) throw std::runtime_error("the path of the gateway is too long");
        std::memcpy(address.sun_path, path.data(), path.size());
        if (link < 0 || connect(link, reinterpret_cast<sockaddr *>(&address), sizeof(address)) != 0)
            throw std::runtime_error("no gateway listens on " + path + "; start it: nims plug gateway -- gateway");
        call(R"({"call":"hello","version":1,"origin":"command"})", "", "welcome");
    }
    ~Gateway() { close(link); }
    Gateway(const Gateway &) = delete;
    Gateway &operator=(const Gateway &) = delete;

    // Sends a call and waits for its reply; any other reply is its refusal.
    void call(const std::string &header, const std::string &body, const std::string &expected) {
        // Little-endian, as the machines are on which nims runs.
        const uint32_t lengths[2] = {uint32_t(header.size()), uint32_t(body.size())};
        write_all(reinterpret_cast<const char *>(lengths), sizeof(lengths));
        write_all(header.data(), header.size());
        write_all(body.data(), body.size());
        uint32_t answered[2];
        read_all(reinterpret_cast<char *>(answered), sizeof(answered));
        std::string reply(answered[0], '\0'), rest(answered[1], '\0');
        read_all(&reply[0], reply.size());
        read_all(&rest[0], rest.size());
        if (reply.find("\"reply\":\"" + expected + "\"") == std::string::npos) throw std::runtime_error(reply);
    }

private:
    void write_all(const char *data, size_t size) {
        while (size > 0) {
            const ssize_t sent = send(link, data, size, MSG_NOSIGNAL);
            if (sent <= 0) throw std::runtime_error("the gateway has closed the connection");
            data += sent, size -= size_t(sent);
        }
    }
    void read_all(char *data, size_t size) {
        while (size > 0) {
            const ssize_t got = recv(link, data, size, 0);
            if (got <= 0) throw std::runtime_error("the gateway has closed the connection");
            data += got, size -= size_t(got);
        }
    }
    int link;
};

uint64_t now_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return uint64_t(now.tv_sec) * 1000000000u + uint64_t(now.tv_nsec);
}

int main(int count, char **arguments) {
    const char *socket_path = count > 1 ? arguments[1] : std::getenv("NIMS_GATEWAY");
    const char *name = count > 2 ? arguments[2] : std::getenv("NIMS_NAME");
    if (!socket_path || !name) {
        std::fprintf(stderr, "the gateway's socket or the sensor's name is missing; give both: ./soil SOCKET NAME\n");
        return 2;
    }
    const std::string sensor = name;
    try {
        Gateway gateway(socket_path);
        const std::string whose = "\"sensor\":\"" + sensor + "\"";
        const std::string declare = R"({"call":"declare","id":1,)" + whose + R"(,"message":")" + MESSAGE + "\"}";
        gateway.call(declare, DEFINITION + HEADER, "done");
        for (uint64_t number = 0;; number++) {
            Example sample{};
            const uint64_t stamp_ns = now_ns();
            read_device(number, sample);
            const std::string body(reinterpret_cast<const char *>(&sample), sizeof(sample));
            const std::string stamp = "\"stamp_ns\":" + std::to_string(stamp_ns);
            const std::string id = std::to_string(number + 2);
            const std::string header = R"({"call":"sample","id":)" + id + "," + whose + "," + stamp + "}";
            gateway.call(header, body, "done");
            std::this_thread::sleep_for(std::chrono::duration<double>(1.0 / RATE_HZ));
        }
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
