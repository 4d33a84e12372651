// Findings of the doctor in Chinese: title and meaning by the name of the check. Observations and commands contain names
// and paths of this machine, and are shown untranslated.

/** @type {Record<string, { title: string, meaning: string }>} */
export const DOCTOR_ZH = {
  "ModemManager": { title: "ModemManager 服务", meaning: "它可能把新插入的端口当作调制解调器：最多 20 秒内端口被占用，并会收到它发送的数据。" },
  "WSL": { title: "Windows 中的 Linux（WSL）", meaning: "USB 设备每次插入后都留在 Windows 中，需要先移交给 Linux。" },
  "brltty": { title: "brltty 服务", meaning: "它会把这类适配器误认为盲文显示器：端口出现一秒后就消失。" },
  "container": { title: "容器", meaning: "容器只能看到启动时传入的设备。" },
  "hid package": { title: "hid 软件包", meaning: "Python 找到的 hid 模块不是 hidapi，或者没有安装，因此无法通过 HID 连接控制板。" },
  "in use": { title: "端口被占用", meaning: "控制板已被其他程序打开。多数端口只允许一个程序；同时使用会互相抢走数据。" },
  "latency timer": { title: "延迟定时器", meaning: "适配器会把收到的数据扣留一段时间才交给程序，每次应答都因此变慢。" },
  "libusb": { title: "libusb 库", meaning: "无法通过 USB 批量传输连接控制板。" },
  "macOS port": { title: "macOS 端口", meaning: "tty. 端口会等待控制板不会发出的载波信号；同名的 cu. 端口不会。" },
  "permissions": { title: "权限", meaning: "您没有打开此设备的权限。" },
  "sandbox": { title: "沙盒", meaning: "这个 Python 的打包方式会对其中的程序隐藏设备。" },
  "udev": { title: "udev 规则", meaning: "该规则不起作用：系统在读取它之前就已处理完设备权限。" },
};
